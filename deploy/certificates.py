"""Certificates of a run that an engine makes by itself, with `deploy/certificates.sh`."""

import subprocess
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509

from common.errors import InputError
from common.transport.credentials import allowed_actors, common_name

_SCRIPT = Path(__file__).with_name("certificates.sh")
_RENEWED = timedelta(days=30)
"""Time before its end at which a certificate is made anew."""


def ensure_certificates(folder: Path, host: str) -> None:
    """Makes those of a hub that is called ``host``, unless the folder has some that last. Raises
    InputError if the script says why it cannot."""
    if not _lasts(folder / "hub.pem", host):
        make_certificates(folder, host)


def certify_actors(folder: Path, host: str, names: Sequence[str]) -> None:
    """Makes those of actors and evaluators that have none which lasts; a hub lets in no others
    then.

    One that was taken off the hub's list stays out. Raises InputError as `make_certificates` does,
    or if the list cannot be read.

    Args:
        host: the hub's name, if the folder has no authority yet.
    """
    if not (folder / "ca-key.pem").exists():
        make_certificates(folder, host)
    listed = allowed_actors(folder) or ()

    def is_due(name: str) -> bool:
        file = folder / f"{common_name('actor', name)}.pem"
        return not file.exists() or (name in listed and not _lasts(file))

    if due := [name for name in names if is_due(name)]:
        make_certificates(folder, "--actors", *due)


def _lasts(file: Path, host: str | None = None) -> bool:
    """Whether a certificate is there, for ``host`` if that is given, and not at its end soon."""
    with suppress(FileNotFoundError, ValueError):
        found = x509.load_pem_x509_certificate(file.read_bytes())
        names = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        right = host is None or host in names.get_values_for_type(x509.DNSName)
        return right and found.not_valid_after_utc > datetime.now(UTC) + _RENEWED
    return False


def make_certificates(folder: Path, *asked: str) -> None:
    """Makes what is ``asked`` of the script, such as a hub's name, by the authority in ``folder``
    if it has one. Raises InputError with what the script says if it cannot."""
    said = subprocess.run(["sh", _SCRIPT, folder, *asked], capture_output=True, text=True)
    if said.returncode:
        raise InputError(f"no certificates can be made ({said.stderr.strip()}): install openssl.")
