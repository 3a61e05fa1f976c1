"""`Cluster`: a run of processes on one machine, each behind a link of its own to the hub."""

import os
import signal
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Self

from benchmarks.chaos.link import Link
from benchmarks.child import free_endpoint
from common.process.supervisor import Child
from common.run.join import find_run
from common.transport.interface import Envelope
from common.transport.zenoh_transport import connect

RUN = "chaos"
HUB, LEARNER = "replay", "learner"
_START = 120.0
_POLL = 0.05
_AWAY = "600"
"""Seconds for which each process waits for one that is away: longer than any fault lasts."""


class Cluster:
    """The processes of a run, by name; a context manager that ends them.

    Args:
        folder: where the run, the logs and the actors' records go.
        flags: of learner and replay.
        actors: number of actors.
    """

    def __init__(self, folder: Path, flags: Sequence[str], actors: int) -> None:
        self.folder = folder
        self.endpoint = free_endpoint()
        self.actors = tuple(f"actor-{number}" for number in range(1, actors + 1))
        self.links: dict[str, Link] = {}
        """The way to the hub of each process but the hub itself."""
        self.processes: dict[str, Child] = {}
        self.starts: dict[str, int] = {}
        """How often each was started."""
        self.ended: list[str] = []
        """Processes that ended by themselves, and how."""
        self._flags = flags
        self._weights = 0
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.callback(self._kill_all)
            for name in (LEARNER, *self.actors):
                self.links[name] = stack.enter_context(Link(self.endpoint))
            self.start(HUB)
            self.transport = stack.enter_context(
                connect(self.endpoint, _START, lambda: self.processes[HUB].poll() is not None)
            )
            keys, self.config = find_run(self.transport, RUN, _START, lambda: False)
            self.transport.subscribe(keys.weights, self._hear_weights)
            for name in (LEARNER, *self.actors):
                self.start(name)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _hear_weights(self, _: Envelope) -> None:
        self._weights += 1

    def _kill_all(self) -> None:
        for process in self.processes.values():
            process.kill()
            process.wait()

    # ------------------------------------------------------------------ processes

    @property
    def records(self) -> list[Path]:
        """What the actors' witnesses wrote."""
        return sorted(self.folder.glob("*.record"))

    @property
    def replay(self) -> Path:
        return self.folder / "runs" / RUN / "replay"

    def start(self, name: str) -> None:
        """Start a process; one that ran before goes on with what it left."""
        count = self.starts[name] = self.starts.get(name, 0) + 1
        run = ("--run", RUN, "--runs", str(self.folder / "runs"))
        again = () if count == 1 else ("--resume",)
        if name == HUB:
            arguments = ("replay", *run, "--listen", self.endpoint, *again, *self._flags)
        elif name == LEARNER:
            link = self.links[name].endpoint
            place = ("--connect", link, "--patience", _AWAY, "--threads", "1")
            arguments = ("learner", *run, *place, *again, *self._flags)
        else:
            arguments = self._actor(name, name)
        self.processes[name] = Child(*arguments, log=self.folder / f"{name}.log")

    def _actor(self, name: str, record: str) -> tuple[str, ...]:
        place = ("--connect", self.links[name].endpoint, "--patience", _AWAY)
        file = str(self.folder / f"{record}.record")
        return ("benchmarks.chaos.witness", file, *place, "--run", RUN, "--name", name)

    def double(self, name: str) -> Child:
        """Start another actor that goes by the name of one that is there."""
        log = self.folder / f"{name}-double.log"
        return Child(*self._actor(name, f"{name}-double"), log=log)

    def kill(self, name: str) -> None:
        """End a process by SIGKILL and start it again at once, as a supervisor would."""
        self.processes[name].kill()
        self.processes[name].wait()
        self.start(name)

    def pause(self, name: str) -> Callable[[], None]:
        """Stop a process; returns what lets it go on."""
        process = self.processes[name]
        os.kill(process.pid, signal.SIGSTOP)
        return lambda: os.kill(process.pid, signal.SIGCONT)

    def rejoin(self, name: str) -> None:
        """Ask an actor to leave, and let another come in its place."""
        self._end(name)
        self.start(name)

    def _end(self, name: str) -> None:
        process = self.processes[name]
        process.end(_START)
        if process.returncode:
            raise process.failure(name)

    def look(self) -> None:
        """Notice, and start again, what ended by itself."""
        for name, process in list(self.processes.items()):
            status = process.poll()
            if status is not None:
                self.ended.append(f"{name} ended with status {status}: {process.last_line()}")
                self.start(name)

    def private_mib(self, name: str) -> float:
        """Memory of a process, without the files that it maps."""
        status = Path(f"/proc/{self.processes[name].pid}/status").read_text()
        return int(status.partition("RssAnon:")[2].split()[0]) / 1024

    # ------------------------------------------------------------------ the work

    def _stored(self) -> dict[str, int]:
        """Chunks that each actor was told are stored."""
        return {
            name: (self.folder / f"{name}.record").read_text().count("acknowledged")
            for name in self.actors
            if (self.folder / f"{name}.record").exists()
        }

    @property
    def stored_steps(self) -> int:
        """Agent steps in the replay, at least: what actors were told is stored."""
        return self.config.stream.chunk_steps * sum(self._stored().values())

    def recovery(self, patience: float) -> float | None:
        """Wait until all work: each actor's next chunk is stored, and new weights come.

        Returns:
            seconds until then, or None after ``patience`` seconds.
        """
        began = time.monotonic()
        before, weights = self._stored(), self._weights
        while (waited := time.monotonic() - began) < patience:
            now = self._stored()
            if self._weights > weights and all(
                now.get(name, 0) > before.get(name, 0) for name in self.actors
            ):
                return waited
            self.look()
            time.sleep(_POLL)
        return None

    def conclude(self) -> None:
        """End all processes: first the actors, who hand in what they have, last the replay.

        Raises:
            InputError: one of them did not end well.
        """
        self.look()
        for name in (*self.actors, LEARNER, HUB):
            self._end(name)
