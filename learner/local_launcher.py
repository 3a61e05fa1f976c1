"""Local mode: actors and an evaluator as children of the learner, watched and ended with it."""

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from common.errors import InputError

ROOT = Path(__file__).resolve().parents[1]
_LEAVE = 3.0
"""Seconds that children have to leave before they are killed."""
_STILLBORN = 15.0
"""A child that ends this soon after its start did not get to work."""
_MOST_STILLBORN = 3
_GIVE_WAY = 10
"""How much lower the children's priority is than ours: a tenth of the processor where both want it.

The learner's thread is what a run in lockstep waits for (benchmarks/LOG.md). A learner that waits
for steps leaves its children the processor all the same.
"""


@dataclass
class _Child:
    name: str
    arguments: list[str]
    process: subprocess.Popen[bytes]
    started: float
    stillborn: int = 0


class LocalLauncher:
    """Children on this machine; one that ends before the run does is started again.

    Each holds the reading end of a pipe, its leash, and leaves when it closes, so that none
    outlives this process, however it ends.

    Args:
        logs: folder for what they print.
        flags: for all of them: how time passes, such as ``["--sync"]``, and their certificates.
        give_way: run them at a lower priority than this process. Not for robots in real time, whose
            deadlines do not wait.
    """

    def __init__(
        self,
        endpoint: str,
        run: str,
        actors: int,
        envs: int,
        evaluators: int,
        logs: Path,
        flags: Sequence[str],
        *,
        give_way: bool,
    ) -> None:
        logs.mkdir(parents=True, exist_ok=True)
        self._logs = logs
        self._give_way = give_way
        common = ["--connect", endpoint, "--run", run, "--leash", *flags]
        plans = [
            (f"actor-{index}", [*common, "--envs", str(envs)]) for index in range(1, actors + 1)
        ] + [(f"evaluator-{index}", [*common, "--evaluator"]) for index in range(1, evaluators + 1)]
        self._children = [self._start(name, arguments) for name, arguments in plans]
        self._leaving = False

    def watch(self, *, finished: bool) -> list[str]:
        """Start those that ended again; returns what happened, as sentences.

        Args:
            finished: whether the run is, so that children leave by themselves.

        Raises:
            InputError: a child cannot start at all.
        """
        notes = []
        for at, child in enumerate(self._children):
            status = child.process.poll()
            if status is None or self._leaving or (status == 0 and finished):
                continue
            how = f"signal {-status}" if status < 0 else f"status {status}"
            early = time.monotonic() - child.started < _STILLBORN
            stillborn = child.stillborn + 1 if early else 0
            if stillborn >= _MOST_STILLBORN:
                raise InputError(
                    f"{child.name} cannot start: it ended {stillborn} times by {how} and said: "
                    f"{self._last_words(child.name)} (more in {self._log(child.name)})."
                )
            self._children[at] = self._start(child.name, child.arguments, stillborn)
            notes.append(f"{child.name} ended by {how}, started again")
        return notes

    def works(self, role: str) -> bool:
        """Whether a child of that role is at work, or on its way to it."""
        return any(
            child.name.startswith(f"{role}-") and child.process.poll() is None
            for child in self._children
        )

    def close(self) -> None:
        """End all children: ask, wait a little, kill."""
        self.let_go()
        deadline = time.monotonic() + _LEAVE
        for child in self._children:
            try:
                child.process.wait(max(deadline - time.monotonic(), 0))
            except subprocess.TimeoutExpired:
                child.process.kill()
                child.process.wait()

    def let_go(self) -> None:
        """Ask all children to leave."""
        self._leaving = True
        for child in self._children:
            leash = child.process.stdin
            if leash is not None and not leash.closed:
                leash.close()

    def _start(self, name: str, arguments: Sequence[str], stillborn: int = 0) -> _Child:
        log: IO[bytes]
        with self._log(name).open("ab") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "actors", "--name", name, *arguments],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                # The terminal's Ctrl-C is for the learner alone. A session of its own would do too,
                # but Linux gives each session an equal share, whatever their priorities.
                process_group=0 if self._give_way else None,
                start_new_session=not self._give_way,
                env=child_environment(),
            )
        if self._give_way:
            ours = os.getpriority(os.PRIO_PROCESS, 0)
            os.setpriority(os.PRIO_PROCESS, process.pid, ours + _GIVE_WAY)
        return _Child(name, list(arguments), process, time.monotonic(), stillborn)

    def _log(self, name: str) -> Path:
        return self._logs / f"{name}.log"

    def _last_words(self, name: str) -> str:
        lines = self._log(name).read_text(errors="replace").strip().splitlines()
        return lines[-1].removeprefix("error: ").rstrip(".") if lines else "nothing"


def child_environment() -> dict[str, str]:
    """Ours, with this checkout first, so that a child runs the same code from any working
    directory."""
    paths = filter(None, (str(ROOT), os.environ.get("PYTHONPATH")))
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
