"""A former version of the program, out of the repository's history."""

import io
import os
import subprocess
import sys
import tarfile
from pathlib import Path

from common.process.supervisor import ROOT

COMMIT = "8f65181"
"""One whose messages are of a former schema."""


class OldVersion:
    """The actors of `COMMIT`, in ``folder``."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.missing = self._unpack()
        """Why it is not there, where that is so."""

    def _unpack(self) -> str | None:
        command = ["git", "-C", str(ROOT), "archive", COMMIT, "actors", "common"]
        try:
            done = subprocess.run(command, capture_output=True)
        except OSError as error:
            return f"git cannot be run ({error.strerror})"
        if done.returncode:
            return f"this is no clone with {COMMIT} in its history"
        with tarfile.open(fileobj=io.BytesIO(done.stdout)) as archive:
            archive.extractall(self._folder, filter="data")
        return None

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        """Start one of its actors; what it says is on its standard output."""
        return subprocess.Popen(
            [sys.executable, "-m", "actors", *arguments],
            cwd=self._folder,
            env={**os.environ, "PYTHONPATH": str(self._folder), "PYTHONSAFEPATH": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
