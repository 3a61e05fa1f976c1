"""`Credentials`: files by which a process proves who it is, and decides whom it trusts.

`deploy/certificates.sh` writes them into a folder. They are for addresses that begin with
``tls/``.
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
from common.endpoint import check_endpoint
from common.errors import InputError

_log = logging.getLogger(__name__)
Role = Literal["hub", "learner", "replay", "actor"]
"""The role in which a process joins a run. An evaluator joins as an actor; a replay is a hub unless
it joins another run's hub."""
_ACTORS = "actors.txt"
"""File, in a hub's folder of certificates, that lists the actors that it admits, one per line."""
_RUNS = "runs.txt"
"""File that lists the other runs whose replays the hub admits, one per line."""


def common_name(role: Role, name: str | None = None) -> str:
    """Returns the common name in a certificate, which is also the name of its files."""
    return role if name is None else f"{role}.{name}"


_KEYS_BY_NAME = f"{common_name('actor', '*')}-key.pem"


def allowed_actors(folder: Path, *, listed: bool = False) -> list[str] | None:
    """Returns the actors that a hub with this folder admits; None if it admits every process with
    an actor's certificate.

    Raises InputError if the list cannot be read, or holds what cannot be a name. With ``listed``,
    it also raises if the list is missing although the folder has certificates of actors by name.
    """
    path = folder / _ACTORS
    names = _names_in(path)
    if names is None and listed and any(folder.glob(_KEYS_BY_NAME)):
        raise InputError(
            f"there are certificates of actors by name, but no {path}: put the list back, or move "
            "the certificates elsewhere to let all actors in."
        )
    return names


def allowed_runs(folder: Path, own: str | None) -> list[str]:
    """Returns the runs whose replays a hub with this folder admits, each by its own certificate.

    Raises InputError if the list cannot be read, holds what cannot be a name, or holds the hub's
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
    """Returns the names in a list, each once; None if there is no list."""
    try:
        names = path.read_text(encoding="ascii").split()
    except FileNotFoundError:
        return None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} cannot be read ({error}): write one name per line.") from None
    for name in names:
        if not re.fullmatch(NAME, name):
            raise InputError(f"{path} holds {name[:70]!r}, which cannot be a name.")
    return list(dict.fromkeys(names))


def own_name(folder: Path) -> str | None:
    """Returns the name of the only actor that has a certificate by name in this folder; None if
    there is none. Raises InputError if there are several."""
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
    """The files of a process, in PEM."""

    authority: Path
    """Certificate of the authority that signed all others."""
    certificate: Path
    """The process' own certificate."""
    key: Path
    """Private key of the certificate."""

    @classmethod
    def find(cls, folder: Path, role: Role, name: str | None = None) -> "Credentials":
        """Returns the credentials in ``folder`` of the process called ``name``, or else of its
        role.

        A certificate that is out of date is logged and not refused, because it may be replaced
        while the process waits. Raises InputError if a file is missing or is not a certificate, if
        key and certificate do not fit, or if the folder has a hub's list without the actor.
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
                    f"there is no {path}: make certificates, where ca-key.pem is, with "
                    f"deploy/certificates.sh{how}, and give this machine ca.pem, {whose}.pem and "
                    f"{whose}-key.pem."
                )
        try:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
            context.load_verify_locations(found.authority)
            # Without a password, OpenSSL would ask a person at the terminal for that of the key.
            context.load_cert_chain(found.certificate, found.key, password="")
        except (ssl.SSLError, OSError) as error:
            raise InputError(
                f"the certificates in {folder} cannot be used ({error}): make new ones with "
                "deploy/certificates.sh."
            ) from None
        for path in (found.authority, found.certificate):
            ended = x509.load_pem_x509_certificate(path.read_bytes()).not_valid_after_utc
            if ended < datetime.now(UTC):
                text = (
                    "%s expired at %s, so nobody accepts it: make a new one with "
                    "deploy/certificates.sh, and replace the file"
                )
                _log.warning(text, path, ended.strftime("%Y-%m-%d %H:%M UTC"))
        return found

    def settings(self, role: Role) -> dict[str, object]:
        """Returns the settings of a Zenoh session: TLS only, with certificates on both sides."""
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
    """Returns the credentials of a process at ``endpoint``; None for a ``tcp/`` address, which
    needs none. Raises InputError if ``endpoint`` is not an address, or does not fit the
    certificates.

    Args:
        certificates: the folder that holds them.
    """
    check_endpoint(endpoint)
    if endpoint.startswith("tcp/"):
        if certificates is not None:
            raise InputError(f"--certificates needs tls: write {endpoint} as tls{endpoint[3:]}.")
        return None
    if certificates is None:
        raise InputError(
            f"{endpoint} needs --certificates FOLDER: make one with deploy/certificates.sh."
        )
    return Credentials.find(certificates, role, name)
