"""`Certificates`: the certificates of a run's processes, which can be made to expire."""

import shutil
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, load_pem_private_key

from benchmarks.child import refusal
from common.process.supervisor import ROOT
from common.transport.credentials import Role


class Certificates:
    """Folders of certificates in ``folder``, one for each process, under one authority.

    Args:
        roles: roles of the processes by name.
    """

    def __init__(self, folder: Path, roles: Mapping[str, Role]) -> None:
        self._folder = folder
        self._roles = roles
        self._valid, self._expired = folder / "valid", folder / "expired"
        self.missing = refusal(ROOT / "deploy/certificates.sh", self._valid, "localhost")
        """Reason why there are no certificates; None if there are."""
        if self.missing is None:
            shutil.copytree(self._valid, self._expired)
            for role in {*roles.values()}:
                ended = expired(self._valid / f"{role}.pem", self._valid / "ca-key.pem")
                (self._expired / f"{role}.pem").write_bytes(ended)
            for name in roles:
                self.of(name).mkdir()
                shutil.copy(self._valid / "ca.pem", self.of(name))
                self.renew(name)

    def of(self, name: str) -> Path:
        """Returns the folder of a process."""
        return self._folder / name

    def expire(self, name: str) -> None:
        """Replaces a process's certificate by one that was valid until yesterday."""
        self._put(self._expired, name)

    def renew(self, name: str) -> None:
        """Replaces a process's certificate by a valid one."""
        self._put(self._valid, name)

    def _put(self, source: Path, name: str) -> None:
        role = self._roles[name]
        for file in (f"{role}.pem", f"{role}-key.pem"):
            shutil.copy(source / file, self.of(name))


def expired(certificate: Path, authority_key: Path) -> bytes:
    """Returns the certificate as if it had been valid until yesterday, in PEM."""
    now = datetime.now(UTC)
    found = x509.load_pem_x509_certificate(certificate.read_bytes())
    builder = x509.CertificateBuilder(
        *(found.issuer, found.subject, found.public_key(), found.serial_number),
        *(now - timedelta(days=2), now - timedelta(days=1)),
        list(found.extensions),
    )
    key = load_pem_private_key(authority_key.read_bytes(), None)
    assert isinstance(key, EllipticCurvePrivateKey)  # as the script makes it
    return builder.sign(key, SHA256()).public_bytes(Encoding.PEM)
