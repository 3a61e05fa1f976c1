"""Real processes over real Zenoh: started, awaited by what they say and write, and cleaned up."""

import json
import os
import signal
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from benchmarks.child import free_endpoint
from tests.forked import FORKS, become
from tests.patience import PATIENCE, wait_until

SMALL = (
    "--replay.learning-starts=200",
    "--replay.capacity=20000",
    "--replay.ratio-tolerance=64",
    "--stream.chunk-steps=16",
    "--protocol.epoch-steps=200",
    "--protocol.test-steps=100",
    "--protocol.held-out-states=64",
    "--learning.batch-size=8",
    "--learning.train-period=4",
    "--learning.checkpoint-period=20",
    "--learning.publish-period=10",
    "--learning.network=nips",  # which is `TINY` here
    "--play.max-game-frames=400",  # a test is at least one whole game
)
"""Settings of a run that is over in seconds."""


class Program:
    """A process of the project under test, with what it printed.

    It is forked, see `forked`, and so are the programs that it starts.
    """

    def __init__(self, folder: Path, name: str, *arguments: str, forks: bool) -> None:
        self.log = folder / f"{name}.log"
        self.log.touch()
        self.process = FORKS.Process(target=become, args=(folder, self.log, arguments, forks))
        self.process.start()

    @property
    def output(self) -> str:
        return self.log.read_text(errors="replace")

    def says(self, text: str, times: int = 1) -> None:
        """Wait until it has printed ``text``, so many times."""

        def said() -> bool:
            is_alive = self.process.is_alive()  # first, for its last words may be those
            if self.output.count(text) >= times:
                return True
            assert is_alive, f"it ended without {text!r}:\n{self.output}"
            return False

        wait_until(said, f"{text!r} is said; so far:\n{self.output}")

    def ends(self, status: int = 0) -> str:
        """Wait for its end with this status; returns what it printed."""
        self.process.join(PATIENCE)
        if self.process.exitcode is None:
            pytest.fail(f"it does not end:\n{self.output}")
        assert self.process.exitcode == status, self.output
        return self.output

    @property
    def child(self) -> int:
        """The one process that it has started."""
        pid = self.process.pid
        return int(Path(f"/proc/{pid}/task/{pid}/children").read_text())

    def send(self, number: signal.Signals) -> None:
        assert self.process.pid is not None
        os.kill(self.process.pid, number)


class Stage:
    """Where one test's processes play: a folder, a port, and a broom."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.programs: list[Program] = []
        self.forks = True
        """Whether the programs that these start are forked too."""
        self.endpoint = free_endpoint()

    def start(self, *arguments: str) -> Program:
        """`python ARGUMENTS` in the test's folder."""
        name = f"{len(self.programs)}-{arguments[1].rsplit('/', 1)[-1]}"
        program = Program(self.folder, name, *arguments, forks=self.forks)
        self.programs.append(program)
        return program

    def learner(self, *arguments: str) -> Program:
        # One thread: other tests and programs may want the cores too.
        place = () if "--connect" in arguments else ("--listen", self.endpoint)
        return self.start("-m", "learner", *place, "--run", "r", "--threads=1", *arguments)

    def actor(self, name: str, *arguments: str) -> Program:
        return self.start(
            "-m", "actors", "--sync", "--connect", self.endpoint, "--name", name, *arguments
        )

    @property
    def run(self) -> Path:
        return self.folder / "runs" / "r"

    def summary(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads((self.run / "summary.json").read_text())
        return found

    def rows(self) -> list[dict[str, str]]:
        header, *lines = (self.run / "epochs.csv").read_text().splitlines()
        return [dict(zip(header.split(","), line.split(","), strict=True)) for line in lines]

    def strays(self) -> set[int]:
        """Processes in the test's folder, apart from the programs: whatever these have started."""
        found = set()
        for entry in Path("/proc").iterdir():
            # A process that has ended has no folder.
            with suppress(OSError):
                if entry.name.isdigit() and (entry / "cwd").samefile(self.folder):
                    found.add(int(entry.name))
        return found - {program.process.pid for program in self.programs}

    def close(self) -> None:
        for program in self.programs:
            program.process.kill()
            program.process.join()


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Stage]:
    stage = Stage(tmp_path)
    yield stage
    stage.close()
    wait_until(lambda: not stage.strays(), f"no process is left of {stage.strays()}")
