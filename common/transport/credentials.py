"""`Credentials`: by what a process shows others on a network who it is, and whom it trusts.

They are files in a folder that `deploy/certificates.sh` writes, and are for addresses that begin
with ``tls/``.
"""

import logging
import re
import ssl
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from cryptography import x509

from common.checked import NAME
from common.errors import InputError
from common.transport.endpoint import check_endpoint

_log = logging.getLogger(__name__)
Role = Literal["hub", "learner", "replay", "actor"]
"""The role in which a process joins a run. An evaluator joins as an actor; a replay is a hub unless
it joins that of another run."""
_ACTORS = "actors.txt"
"""Names the actors that a hub lets in, a line each, in its folder of certificates."""
_RUNS = "runs.txt"
"""Likewise the runs whose replays it lets in beside its own."""


def common_name(role: Role, name: str | None = None) -> str:
    """Whom a certificate is made out to, and what its files are called."""
    return role if name is None else f"{role}.{name}"


_KEYS_BY_NAME = f"{common_name('actor', '*')}-key.pem"


def allowed_actors(folder: Path, *, listed: bool = False) -> list[str] | None:
    """The actors that a hub with this folder lets in; None for all with an actor's certificate,
    unless those that have certificates here have to be ``listed``.

    Raises InputError if the list is missing, cannot be read, or holds what cannot be a name.
    """
    path = folder / _ACTORS
    names = _names_in(path)
    if names is None and listed and any(folder.glob(_KEYS_BY_NAME)):
        raise InputError(
            f"there are certificates of actors by name, and no {path}: put the list back, or "
            "the certificates elsewhere to let all actors in."
        )
    return names


def allowed_runs(folder: Path, own: str | None = None) -> list[str]:
    """The runs whose replays a hub with this folder lets in, each by a certificate of its own.

    Raises InputError if the list cannot be read, or holds what cannot be a name or the hub's
    ``own`` run.
    """
    runs = _names_in(folder / _RUNS) or []
    if own in runs:
        raise InputError(
            f"{folder / _RUNS} lists {own}, the hub's own run, so whoever has its certificate "
            "could answer beside the hub: delete the line, or give this run another name."
        )
    return runs


def _names_in(path: Path) -> list[str] | None:
    """The names that a list holds, each once; None where there is no list."""
    try:
        names = path.read_text(encoding="ascii").split()
    except FileNotFoundError:
        return None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} cannot be read ({error}): it has a name in each line.") from None
    for name in names:
        if not re.fullmatch(NAME, name):
            raise InputError(f"{path} holds {name[:70]!r}, which cannot be a name.")
    return list(dict.fromkeys(names))


def own_name(folder: Path) -> str | None:
    """The one actor that this folder has a certificate of by name; None where it has no such.
    Raises InputError if it has several."""
    files = sorted(folder.glob(_KEYS_BY_NAME))
    names = [path.name.removeprefix("actor.").removesuffix("-key.pem") for path in files]
    if len(names) > 1:
        raise InputError(
            f"{folder} has certificates of {', '.join(names[:5])}{' …' if names[5:] else ''}: "
            "choose an actor with --name."
        )
    return names[0] if names else None


@dataclass(frozen=True)
class Credentials:
    """A process' files in PEM."""

    authority: Path
    """Certificate of whoever signed all the others."""
    certificate: Path
    """Its own."""
    key: Path
    """The certificate's private one."""

    @classmethod
    def find(cls, folder: Path, role: Role, name: str | None = None) -> "Credentials":
        """Those in ``folder`` of the process called ``name`` if there are such, or of its role.

        What is out of date is logged, and not refused: it may be replaced while a process waits.
        Raises InputError if one is missing or is no certificate, if key and certificate do not fit,
        or if the hub's folder, if it is that, does not list the actor.
        """
        whose = common_name(role, name)
        listed = allowed_actors(folder) if role == "actor" else None
        if listed is not None and name is not None and name not in listed:
            raise InputError(
                f"{folder / _ACTORS} does not list {name}: make its certificate with "
                f"`deploy/certificates.sh {folder} --actors {name}`, and start the hub again."
            )
        role_wide = (folder / f"{common_name(role)}.pem").is_file()
        by_name = role == "actor" and any(folder.glob(_KEYS_BY_NAME)) and not role_wide
        if role == "actor" and not by_name and not (folder / f"{whose}.pem").is_file():
            whose = common_name(role)
        found = cls(folder / "ca.pem", folder / f"{whose}.pem", folder / f"{whose}-key.pem")
        for path in (found.authority, found.certificate, found.key):
            if not path.is_file():
                flag = "--runs" if role == "replay" else "--actors" if by_name else None
                how = "" if flag is None else f" {folder} {flag} {name}"
                raise InputError(
                    f"there is no {path}: make certificates with deploy/certificates.sh{how}, and "
                    f"give this machine ca.pem, {whose}.pem and {whose}-key.pem."
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
        for path in (found.authority, found.certificate):
            ended = x509.load_pem_x509_certificate(path.read_bytes()).not_valid_after_utc
            if ended < datetime.now(UTC):
                _log.warning(
                    "%s is out of date since %s: nobody accepts it; make it anew with "
                    "deploy/certificates.sh, and replace the file",
                    *(path, ended.strftime("%Y-%m-%d %H:%M UTC")),
                )
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


def check_certificates(
    endpoint: str, certificates: Path | None, role: Role, name: str | None = None
) -> Credentials | None:
    """By what a process proves who it is at ``endpoint``; None at one where nobody asks. Raises
    InputError if ``endpoint`` is no address, or it and the certificates do not fit each other.

    Args:
        certificates: the folder that holds them.
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
    return Credentials.find(certificates, role, name)
