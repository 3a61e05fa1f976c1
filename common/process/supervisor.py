"""Child processes of this one, which are started, watched, restarted, and ended with it.

Each is ``python -m MODULE`` from this checkout, whatever the working directory is.
"""

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common.errors import InputError, writing
from common.exit_codes import BAD_INPUT
from common.process.backoff import SETTLED, growing_pause
from common.process.lifeline import GRACE, LEASH
from common.process.service_manager import without
from common.regular_file import no_links
from common.schedule import Now

ROOT = Path(__file__).resolve().parents[2]
_EARLY = 15.0
"""A child that lives for fewer seconds than this did not begin its work."""
_MAX_EARLY_ENDS = 3
_TAIL = 4_096
"""Characters at the end of a log, or of a piped standard error, that may hold the last line."""
_SILENCE = "nothing"
"""What a child said that wrote no line."""
_LOWER_PRIORITY = 10
"""Difference in niceness: the child gets a tenth of the processor if both want it.

A run in lockstep waits for the learner's thread (benchmarks/LOG.md). While the learner waits for
steps, its children have the processor all the same.
"""


class Child(subprocess.Popen[str]):
    """A child process, which the terminal's Ctrl-C does not reach.

    Args:
        leash: whether it holds the reading end of a pipe and ends when that closes, so that it
            does not outlive this process, however this one ends (`leave_with_parent`).
        low_priority: whether it runs at a lower priority than this process.
        log: file to which its output is appended; its folder is made if it is missing.
        streams: stdin, stdout and stderr as for `subprocess.Popen`; by default there is no input.
            A thread reads a piped standard error, so that a child that writes much is not blocked.
    """

    def __init__(
        self,
        module: str,
        *arguments: str,
        leash: bool = False,
        low_priority: bool = False,
        log: Path | None = None,
        **streams: Any,
    ) -> None:
        self.log = log
        self._leash = leash
        streams.setdefault("stdin", subprocess.PIPE if leash else subprocess.DEVNULL)
        with contextlib.ExitStack() as stack:
            if log is not None:
                with writing(log):
                    log.parent.mkdir(parents=True, exist_ok=True)
                    file = stack.enter_context(open(log, "ab", opener=no_links))
                streams = {"stdout": file, "stderr": subprocess.STDOUT, **streams}
            super().__init__(
                [sys.executable, "-m", module, *arguments, *([LEASH] if leash else [])],
                text=True,
                errors="replace",
                # Each child could have a session of its own, but Linux gives every session an
                # equal share of the processor, whatever the priorities are.
                process_group=0 if low_priority else None,
                start_new_session=not low_priority,
                env=_environment(),
                **streams,
            )
        if low_priority:
            ours = os.getpriority(os.PRIO_PROCESS, 0)
            os.setpriority(os.PRIO_PROCESS, self.pid, ours + _LOWER_PRIORITY)
        self._said = ""
        self._reader = threading.Thread(target=self._read_errors, name="stderr", daemon=True)
        if self.stderr is not None:
            self._reader.start()

    def _read_errors(self) -> None:
        assert self.stderr is not None
        with self.stderr:
            while text := self.stderr.read(_TAIL):
                self._said = (self._said + text)[-_TAIL:]

    def last_line(self) -> str:
        """Returns the last line that an ended child wrote to its log or its piped standard error.

        An error's prefix and full stop are removed, so that the line fits into a sentence. A log
        that cannot be read counts as empty.
        """
        said = ""
        if self.log is not None:
            with contextlib.suppress(OSError), self.log.open("rb") as log:
                log.seek(max(log.seek(0, os.SEEK_END) - _TAIL, 0))
                said = log.read().decode(errors="replace")
        else:
            if self.stderr is not None:
                self._reader.join()
            said = self._said
        lines = said.strip().splitlines() or [_SILENCE]
        return lines[-1].removeprefix("error: ").rstrip(".")

    def failure(self, name: str) -> InputError:
        """Returns the error that says that the child called ``name`` ended by itself."""
        return InputError(f"the {name} ended, and said: {self.last_line()}.")

    def ask_to_leave(self) -> None:
        """Asks the child to end: closes its leash, or sends SIGTERM if it has none."""
        if not self._leash:
            self.terminate()
        elif self.stdin is not None:
            self.stdin.close()

    def end(self, seconds: float = 30.0) -> None:
        """Asks the child to end, kills it if it is still there after ``seconds``, and closes its
        pipes."""
        self.ask_to_leave()
        try:
            self.wait(max(seconds, 0))
        except subprocess.TimeoutExpired:
            self.kill()
            self.wait()
        for stream in (self.stdin, self.stdout):
            if stream is not None:
                with contextlib.suppress(BrokenPipeError):
                    stream.close()


@dataclass
class Supervisor:
    """Restarts children that end before the work does, after growing pauses."""

    plans: Mapping[str, Callable[[], Child]]
    """By each child's name, the function that starts it."""
    now: Now = time.monotonic

    def __post_init__(self) -> None:
        self._children = {name: start() for name, start in self.plans.items()}
        self._started = dict.fromkeys(self.plans, self.now())
        self._early_ends = dict.fromkeys(self.plans, 0)
        self._restarts = dict.fromkeys(self.plans, 0)
        """Number of restarts of each child in a row, failed ones included."""
        self._due: dict[str, float] = {}
        """Time at which each child that waits is restarted."""
        self._leaving = False

    def watch(self, *, finished: Callable[[], bool]) -> list[str]:
        """Restarts children that have ended and paused; returns what happened, as sentences.

        The first restart is immediate; later ones come 1, 2, 4 … 60 s after the end, or after a
        restart that the system refused. This method never waits: a restart happens at the first
        call after its pause. Raises InputError if a child cannot start at all: with its own
        sentence if it cannot do what was asked.

        Args:
            finished: tells whether the work is finished, so that children end by themselves; it is
                asked after an end is found, so that none comes before its reason.
        """
        notes = []
        for name, child in self._children.items():
            now, status = self.now(), child.poll()
            if status == 0 and finished():
                self._due.pop(name, None)
                continue
            if name in self._due:
                if now >= self._due[name]:
                    notes.append(f"{name} {self._start(name, now)}")
                continue
            if status is None or self._leaving:
                continue
            how = f"signal {-status}" if status < 0 else f"status {status}"
            worked = now - self._started[name]
            if status == BAD_INPUT and worked <= SETTLED:  # however slowly it found out
                said = child.last_line()
                raise InputError(f"{name} ended: {said} (more in {child.log}).")
            self._early_ends[name] = self._early_ends[name] + 1 if worked < _EARLY else 0
            if self._early_ends[name] >= _MAX_EARLY_ENDS:
                raise InputError(
                    f"{name} cannot start: it ended {_MAX_EARLY_ENDS} times by {how} and said: "
                    f"{child.last_line()} (more in {child.log})."
                )
            if status > 0 and (said := child.last_line()) != _SILENCE:
                how += f" ({said})"
            if worked > SETTLED:
                self._restarts[name] = 0
            notes.append(f"{name} ended by {how}, {self._start_or_pause(name, now)}")
        return notes

    def _start_or_pause(self, name: str, now: float) -> str:
        """Starts a child, or has it started after a pause; returns which, in words."""
        pause = growing_pause(self._restarts[name])
        self._restarts[name] += 1
        if not pause:
            return self._start(name, now)
        self._due[name] = now + pause
        return f"next try in {pause:.0f} s"

    def _start(self, name: str, now: float) -> str:
        try:
            self._children[name] = self.plans[name]()
        except OSError as error:  # such as of a system that has no memory left at the moment
            return f"cannot be started ({error.strerror}), {self._start_or_pause(name, now)}"
        self._due.pop(name, None)
        self._started[name] = now
        return "started again"

    def works(self, role: str) -> bool:
        """Whether a child with a name such as ``role-1`` is at work, or about to be restarted."""
        return any(name.startswith(f"{role}-") for name in self.at_work())

    def at_work(self) -> set[str]:
        """Returns the names of the children that are at work, or about to be restarted."""
        return {
            name
            for name, child in self._children.items()
            if name in self._due or child.poll() is None
        }

    def ask_to_leave(self) -> None:
        """Asks all children to end; none is restarted."""
        self._leaving = True
        self._due.clear()
        for child in self._children.values():
            child.ask_to_leave()

    def close(self) -> None:
        """Ends all children: asks them, waits a little, kills the rest."""
        self.ask_to_leave()
        deadline = time.monotonic() + GRACE
        for child in self._children.values():
            child.end(deadline - time.monotonic())


def _environment() -> dict[str, str]:
    """Returns this process' environment, with this checkout first on the module path. Otherwise
    folders of the working directory could take the place of its packages.

    Output is not buffered. Otherwise what an environment of another package printed would follow
    the error in the log, and be told as the reason.
    """
    found = without(dict(os.environ))
    paths = filter(None, (str(ROOT), found.get("PYTHONPATH")))
    own = {"PYTHONPATH": os.pathsep.join(paths), "PYTHONSAFEPATH": "1", "PYTHONUNBUFFERED": "1"}
    return {**found, **own}
