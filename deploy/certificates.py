"""Certificates that a launcher makes for a run, with `deploy/certificates.sh`."""

import shutil
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
"""Remaining validity below which a certificate is renewed."""


def ensure_certificates(folder: Path, host: str) -> None:
    """Makes the certificates of a hub called ``host``, unless the folder has some that last. Raises
    InputError with the script's reason if it fails."""
    if not _lasts(folder / "hub.pem", host):
        make_certificates(folder, host)


def certify_actors(folder: Path, host: str, names: Sequence[str]) -> None:
    """Makes certificates for those actors and evaluators that have none that lasts.

    The hub then admits no others. A name that was taken off the hub's list stays out. Raises
    InputError as `make_certificates` does, or if the list cannot be read.

    Args:
        host: the hub's name, needed if the folder has no authority yet.
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
    """Whether ``file`` is a certificate, for ``host`` if given, that does not end soon."""
    with suppress(FileNotFoundError, ValueError, x509.ExtensionNotFound):
        found = x509.load_pem_x509_certificate(file.read_bytes())
        names = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        right = host is None or host in names.get_values_for_type(x509.DNSName)
        return right and found.not_valid_after_utc > datetime.now(UTC) + _RENEWED
    return False


def make_certificates(folder: Path, *asked: str) -> None:
    """Runs the script with the arguments ``asked``, such as a hub's name. It uses the authority in
    ``folder`` if there is one. Raises InputError with the script's reason if it fails."""
    said = subprocess.run(["sh", _SCRIPT, folder, *asked], capture_output=True, text=True)
    if said.returncode:
        remedy = "fix that" if shutil.which("openssl") else "install openssl"
        raise InputError(f"no certificates can be made ({said.stderr.strip()}): {remedy}.")
