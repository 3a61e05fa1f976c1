"""A former version of the program, taken from the repository's history."""

import os
import subprocess
import sys
import tarfile
from pathlib import Path

from benchmarks.child import refusal
from common.process.supervisor import ROOT

COMMIT = "8f65181"
"""A commit whose messages have a former schema."""


class OldVersion:
    """The program of `COMMIT`, unpacked into ``folder``; it starts its actors."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.missing = self._unpack()
        """Reason why it could not be unpacked; None if it was."""

    def _unpack(self) -> str | None:
        archive = self._folder.with_suffix(".tar")
        command = ("git", "-C", ROOT, "archive", "-o", archive, COMMIT, "actors", "common")
        missing = refusal(*command)
        if missing is None:
            with tarfile.open(archive) as packed:
                packed.extractall(self._folder, filter="data")
        return missing

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        """Starts one of its actors; its messages go to its standard output."""
        return subprocess.Popen(
            [sys.executable, "-m", "actors", *arguments],
            cwd=self._folder,
            env={**os.environ, "PYTHONPATH": str(self._folder), "PYTHONSAFEPATH": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
