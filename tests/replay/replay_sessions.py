"""Talking to a replay server over Zenoh."""

import zenoh

from common.errors import MessageError
from common.protocol.ack import Ack
from common.protocol.chunk import Chunk
from common.protocol.run_keys import RunKeys
from tests.replay.replay_reference import RUN

KEYS = RunKeys(RUN)


def ask(session: zenoh.Session, key: str, payload: bytes) -> bytes:
    """The one answer.

    Raises:
        MessageError: the server refused.
    """
    for reply in session.get(key, payload=payload, timeout=20.0):
        if reply.ok is not None:
            return reply.ok.payload.to_bytes()
        if reply.err is not None:
            raise MessageError(reply.err.payload.to_bytes().decode())
    raise AssertionError("no answer")


def insert(session: zenoh.Session, chunk: Chunk) -> Ack:
    return Ack.decode(ask(session, KEYS.insert(chunk.actor), chunk.encode()))
