"""A person at a terminal of the test's own."""

import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import sys
import termios
import time

from tests.paths import ROOT
from tests.patience import PATIENCE


class Person:
    """Sits at a pseudo-terminal in which `python -m viewer COMMAND` runs.

    It is forked (see `forked`): so the terminal is its own, and Ctrl-C goes to it.
    """

    def __init__(self, *arguments: str, columns: int = 80, rows: int = 24) -> None:
        self.master, self.slave = pty.openpty()
        fcntl.ioctl(self.slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        self.before = termios.tcgetattr(self.slave)
        self.seen = b""
        self.process = subprocess.Popen(
            [sys.executable, "-m", "viewer", *arguments],
            cwd=ROOT,
            env=os.environ | {"TERM": "xterm-256color"},  # whatever the tests' own terminal is
            stdin=self.slave,
            stdout=self.slave,
            stderr=self.slave,
            start_new_session=True,
        )

    def types(self, keys: bytes) -> None:
        os.write(self.master, keys)

    def sees(self, pattern: str, *, typing: bytes = b"") -> None:
        """Look until ``pattern`` has come, typing all the while."""
        deadline = time.monotonic() + PATIENCE
        while not re.search(pattern, self.seen.decode(errors="replace")):
            there = self.process.poll() is None and time.monotonic() < deadline
            if there and typing:
                self.types(typing)
            more = self._look(0.05)
            assert there or more, self.seen[-500:]

    def leaves(self) -> int:
        """Wait for the end, looking on so that it is not held up; the exit status."""
        deadline = time.monotonic() + PATIENCE
        while self.process.poll() is None:
            assert time.monotonic() < deadline, self.seen[-500:]
            self._look(0.05)
        while self._look(0.0):
            pass
        return self.process.returncode

    def _look(self, seconds: float) -> bool:
        ready, _, _ = select.select([self.master], [], [], seconds)
        if ready:
            self.seen += os.read(self.master, 65_536)
        return bool(ready)

    def has_the_terminal_back(self) -> bool:
        """Modes as before, the cursor shown and the first screen back."""
        return (
            termios.tcgetattr(self.slave) == self.before
            and self.seen.rfind(b"\x1b[?25h") > self.seen.rfind(b"\x1b[?25l")
            and self.seen.rfind(b"\x1b[?1049l") > self.seen.rfind(b"\x1b[?1049h")
        )

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        os.close(self.master)
        os.close(self.slave)
