"""`Credentials`: by what a process shows others on a network which role it has, and whom it trusts.

They are files in a folder that `deploy/certificates.sh` writes, and are for addresses that begin
with ``tls/``.
"""

import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from common.errors import InputError
from common.transport.endpoint import check_endpoint

Role = Literal["hub", "learner", "actor"]
"""As what a process joins a run; the common name in its certificate. Evaluators are actors."""


@dataclass(frozen=True)
class Credentials:
    """One role's files in PEM."""

    authority: Path
    """Certificate of whoever signed all the others."""
    certificate: Path
    """The role's own."""
    key: Path
    """The certificate's private one."""

    @classmethod
    def find(cls, folder: Path, role: Role) -> "Credentials":
        """Those of ``role`` in ``folder``.

        Raises:
            InputError: one is missing, is no certificate, or key and certificate do not fit.
        """
        found = cls(folder / "ca.pem", folder / f"{role}.pem", folder / f"{role}-key.pem")
        for path in (found.authority, found.certificate, found.key):
            if not path.is_file():
                raise InputError(
                    f"there is no {path}: make certificates with deploy/certificates.sh, and give "
                    f"this machine ca.pem, {role}.pem and {role}-key.pem."
                )
        try:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
            context.load_verify_locations(found.authority)
            context.load_cert_chain(found.certificate, found.key)
        except (ssl.SSLError, OSError) as error:
            raise InputError(
                f"the certificates in {folder} cannot be used ({error}): make them anew with "
                "deploy/certificates.sh."
            ) from None
        return found

    def settings(self, role: Role) -> dict[str, object]:
        """Returns a Zenoh session's settings: TLS alone, with certificates on both sides."""
        side = "listen" if role == "hub" else "connect"
        return {
            "transport/link/protocols": ["tls"],
            "transport/link/tls/root_ca_certificate": str(self.authority),
            f"transport/link/tls/{side}_certificate": str(self.certificate),
            f"transport/link/tls/{side}_private_key": str(self.key),
            "transport/link/tls/enable_mtls": True,
            "transport/link/tls/verify_name_on_connect": True,
        }


def check_certificates(endpoint: str, certificates: Path | None, role: Role) -> Credentials | None:
    """By what a process proves its role at ``endpoint``; None at one where nobody asks.

    Args:
        certificates: the folder that holds them.

    Raises:
        InputError: ``endpoint`` is no address, or it and the certificates do not fit each other.
    """
    check_endpoint(endpoint)
    if endpoint.startswith("tcp/"):
        if certificates is not None:
            raise InputError(f"--certificates are for tls: write {endpoint} as tls{endpoint[3:]}.")
        return None
    if certificates is None:
        raise InputError(
            f"{endpoint} needs --certificates FOLDER: make one with deploy/certificates.sh."
        )
    return Credentials.find(certificates, role)
