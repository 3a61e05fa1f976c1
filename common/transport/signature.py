"""Signatures of weights, by which actors recognise the learner's own weights.

A hub relays all messages between its processes, and a hub that was taken over could send messages
in their names. So at addresses that begin with ``tls/``, the learner signs weights with the key of
its own certificate, which a hub need not have.
"""

import hashlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from common.errors import InputError, MessageError
from common.protocol.message import Message
from common.transport.credentials import Credentials, common_name

Sign = Callable[[str, int, str, bytes], bytes]
"""Returns the signature of weights, given their purpose, version, run's identity and bytes."""
Check = Callable[[str, int, str, bytes, bytes], None]
"""Raises MessageError unless its last argument is the learner's signature of the other arguments,
which are those of `Sign`."""
_ALGORITHM = ec.ECDSA(hashes.SHA256())


@dataclass(frozen=True)
class Signature(Message):
    """A signature, which travels beside weights."""

    certificate: bytes
    """The signer's certificate, in DER."""
    signature: bytes
    """The signature by ECDSA with SHA-256."""


def unsigned(*_: object) -> bytes:
    """Implements `Sign` without certificates."""
    return b""


def unchecked(*_: object) -> None:
    """Implements `Check` without certificates."""


def signer(certificates: Path | None) -> Sign:
    """Returns the function that signs with the learner's certificate in this folder.

    It reads the files again each time, because they may be renewed while the learner works. Without
    a folder it does not sign. Raises InputError if the certificate is missing or cannot be used.
    """
    if certificates is None:
        return unsigned
    own = Credentials.find(certificates, "learner")
    pair = _pair(own)

    def sign(purpose: str, version: int, run_id: str, weights: bytes) -> bytes:
        nonlocal pair
        with suppress(OSError, ValueError, TypeError, InputError):  # half renewed: keep the old
            fresh = _pair(own)
            if fresh[0].public_key() == fresh[1].public_key():
                pair = fresh
        key, certificate = pair
        signed = key.sign(_signed(purpose, version, run_id, weights), _ALGORITHM)
        return Signature(certificate.public_bytes(serialization.Encoding.DER), signed).encode()

    return sign


def _pair(own: Credentials) -> tuple[ec.EllipticCurvePrivateKey, x509.Certificate]:
    """Returns the present key and certificate. Raises InputError if the key is of another kind."""
    key = serialization.load_pem_private_key(own.key.read_bytes(), None)
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise InputError(
            f"{own.key} is not an elliptic-curve key: make a new one with deploy/certificates.sh."
        )
    return key, x509.load_pem_x509_certificate(own.certificate.read_bytes())


def checker(credentials: Credentials | None) -> Check:
    """Returns the function that checks signatures against the authority of ``credentials``."""
    if credentials is None:
        return unchecked
    authority = x509.load_pem_x509_certificate(credentials.authority.read_bytes())

    def check(purpose: str, version: int, run_id: str, weights: bytes, signature: bytes) -> None:
        if not signature:
            raise MessageError("they are not signed")
        told = Signature.decode(signature)
        try:
            key = _learners_key(told.certificate, authority)
            key.verify(told.signature, _signed(purpose, version, run_id, weights), _ALGORITHM)
        except InvalidSignature:
            raise MessageError("their signature does not fit") from None

    return check


def _learners_key(told: bytes, authority: x509.Certificate) -> ec.EllipticCurvePublicKey:
    """Returns the public key of the learner's certificate ``told``. Raises MessageError if the
    certificate is not a learner's by this authority, or is out of date."""
    try:
        certificate = x509.load_der_x509_certificate(told)
        certificate.verify_directly_issued_by(authority)
        key = certificate.public_key()
    except (ValueError, TypeError, x509.InvalidVersion, InvalidSignature, UnsupportedAlgorithm):
        raise MessageError("their signer's certificate is not of our authority") from None
    names = certificate.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)
    role = common_name("learner")
    if [name.value for name in names] != [role] or not isinstance(key, ec.EllipticCurvePublicKey):
        raise MessageError(f"their signer's certificate is not that of a {role}")
    if not certificate.not_valid_before_utc <= datetime.now(UTC) <= certificate.not_valid_after_utc:
        raise MessageError("their signer's certificate is out of date")
    return key


def _signed(purpose: str, version: int, run_id: str, weights: bytes) -> bytes:
    """Returns the bytes to sign, which differ if weights, purpose, version or run differ."""
    return hashlib.sha256(weights).digest() + f"{purpose} {version} {run_id}".encode()
