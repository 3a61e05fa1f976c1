"""Certificates of a run that an engine makes by itself, with `deploy/certificates.sh`."""

import subprocess
from contextlib import suppress
from pathlib import Path

from common.errors import InputError

_SCRIPT = Path(__file__).with_name("certificates.sh")


def ensure_certificates(folder: Path, host: str) -> None:
    """Makes those of a hub that is called ``host``, unless the folder has them.

    Raises:
        InputError: the script says why it cannot.
    """
    question = ["openssl", "x509", "-in", str(folder / "hub.pem"), "-noout", "-checkhost", host]
    with suppress(FileNotFoundError):  # of openssl, which the script misses too
        said = subprocess.run(question, capture_output=True, text=True)
        if "does match" in said.stdout:
            return
    make_certificates(folder, host)


def make_certificates(folder: Path, host: str) -> None:
    """Makes those of a hub that is called ``host``, by the authority in ``folder`` if it has one.

    Raises:
        InputError: the script says why it cannot.
    """
    command = ["sh", str(_SCRIPT), str(folder), host]
    said = subprocess.run(command, capture_output=True, text=True)
    if said.returncode:
        raise InputError(f"no certificates can be made ({said.stderr.strip()}): install openssl.")
