"""Certificates of `deploy/certificates.sh`."""

import subprocess
from pathlib import Path

from tests.paths import ROOT

SCRIPT = ROOT / "deploy" / "certificates.sh"


def certify(folder: Path, *arguments: str) -> Path:
    """Runs the script for ``folder``, by default for a hub, its learner and its actors."""
    subprocess.run([SCRIPT, folder, *(arguments or ("hub.example.org",))], check=True)
    return folder
