"""A checksum of each message, because TCP's own misses damage that occurs in long runs.

Four bytes precede a message's attachment: the CRC-32 of its key, attachment and payload. A message
whose checksum does not match counts as lost: a request or its answer is sent again, and a
publication is followed by the next one.
"""

from common.crc32 import crc32

_BYTES = 4


class DamagedMessage(Exception):
    """The checksum of a message does not match; its sender should send it again."""


def seal(key: str, payload: bytes, attachment: bytes = b"") -> bytes:
    """Returns ``attachment`` with the message's checksum before it."""
    return _checksum(key, payload, attachment) + attachment


def unseal(key: str, payload: bytes, sealed: bytes) -> bytes:
    """Returns the attachment without the checksum. Raises DamagedMessage if the checksum does not
    match."""
    attachment = sealed[_BYTES:]
    if sealed[:_BYTES] != _checksum(key, payload, attachment):
        raise DamagedMessage("it was damaged on its way, or its sender has another version")
    return attachment


def _checksum(key: str, payload: bytes, attachment: bytes) -> bytes:
    return crc32(payload, crc32(attachment, crc32(key.encode()))).to_bytes(_BYTES)
