"""Certificates of a run that an engine makes by itself, with `deploy/certificates.sh`."""

import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from common.errors import InputError
from common.transport.credentials import common_name

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


def certify_actors(folder: Path, host: str, names: Sequence[str]) -> None:
    """Makes those of actors and evaluators that have none yet; a hub lets in no others then.

    One that was taken off the hub's list stays out.

    Args:
        host: the hub's name, if the folder has no authority yet.

    Raises:
        InputError: the script says why it cannot.
    """
    if not (folder / "ca-key.pem").exists():
        make_certificates(folder, host)
    new = [name for name in names if not (folder / f"{common_name('actor', name)}.pem").exists()]
    if new:
        make_certificates(folder, "--actors", *new)


def make_certificates(folder: Path, *asked: str) -> None:
    """Makes what is ``asked`` of the script, such as a hub's name, by the authority in ``folder``
    if it has one.

    Raises:
        InputError: the script says why it cannot.
    """
    said = subprocess.run(["sh", _SCRIPT, folder, *asked], capture_output=True, text=True)
    if said.returncode:
        raise InputError(f"no certificates can be made ({said.stderr.strip()}): install openssl.")
