"""`Cluster`: the processes of a run on one machine, each with a link of its own to the hub."""

import os
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Self

from benchmarks.chaos.audit import RecordedTest, recorded_tests
from benchmarks.chaos.certificates import Certificates
from benchmarks.chaos.clock import Clocks
from benchmarks.chaos.disk import Disk
from benchmarks.chaos.link import Link
from benchmarks.chaos.old_version import OldVersion
from benchmarks.child import free_endpoint
from common.errors import Unreachable
from common.process.supervisor import Child
from common.protocol.wire import decode_version
from common.run.folder import RunFolder
from common.run.join import find_run
from common.transport.chosen import connect
from common.transport.credentials import Role
from common.transport.interface import Envelope

RUN = "chaos"
HUB, LEARNER, EVALUATOR = "replay", "learner", "evaluator-1"
_AUDITOR = "auditor"
_START = 120.0
_POLL = 0.05
_AWAY = "600"
"""Seconds for which each process waits for another that is away: longer than any fault."""
_SPARE_BYTES = 2**28
"""Room on the run's disk beside the replay, for checkpoints, snapshots, tables and curves."""
_ROW_BYTES = 84 * 84 + 100
_ROLES: dict[str, Role] = {HUB: "hub", LEARNER: "learner"}


class Cluster:
    """The processes of a run, by name; a context manager that ends them.

    Args:
        folder: for the run, the logs and the actors' records.
        flags: flags of learner and replay.
        actors: number of actors.
        evaluator: whether an evaluator tests the epochs.
        capacity: capacity of the replay, in steps.
        goal: agent steps after which the run ends by itself, if it does.
        plain: whether to run without certificates.
        start: starts each process but the hub, as ``start(module, *arguments, log=...)``. These
            processes then have no clocks of their own.
    """

    def __init__(
        self,
        folder: Path,
        flags: Sequence[str],
        actors: int,
        *,
        evaluator: bool = True,
        capacity: int,
        goal: int | None = None,
        plain: bool = False,
        start: Callable[..., Child] | None = None,
    ) -> None:
        self.folder = folder
        self.endpoint = free_endpoint()
        self.actors = tuple(f"actor-{number}" for number in range(1, actors + 1))
        self.links: dict[str, Link] = {}
        """Link to the hub of each process but the hub itself."""
        self.processes: dict[str, Child] = {}
        self.starts: dict[str, int] = {}
        """Number of starts of each process."""
        self.ended: list[str] = []
        """Processes that ended by themselves, and how."""
        self.finished = False
        """Whether the run has reached its goal and its learner has ended."""
        self.published = 0
        """Number of times that weights came."""
        self.steps_back = 0
        """Number of times that weights came that were older than those before."""
        self._evaluators = (EVALUATOR,) if evaluator else ()
        self.clients = (LEARNER, *self.actors, *self._evaluators)
        self.everyone = (HUB, *self.clients)
        self._roles: dict[str, Role] = {
            name: _ROLES.get(name, "actor") for name in (*self.everyone, _AUDITOR)
        }
        self.clocks = Clocks(folder)
        self.clocked = self.everyone if start is None else (HUB,)
        """Processes whose clocks can be moved."""
        self.certificates = Certificates(folder / "certificates", self._roles)
        self.no_certificates = "the run is a plain one" if plain else self.certificates.missing
        self.disk = Disk(folder / "runs", capacity * _ROW_BYTES + _SPARE_BYTES)
        self.old_version = OldVersion(folder / "old")
        self._flags = (*flags, "--replay.capacity", str(capacity))
        self._goal = () if goal is None else ("--steps", str(goal))
        self._start = start
        self._version = 0
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(self.disk)
            stack.callback(self._kill_all)
            for name in self.clients:
                self.links[name] = stack.enter_context(Link(self.endpoint))
            self.start(HUB)
            self.transport = stack.enter_context(
                connect(
                    *(self.address(HUB), _START, lambda: self.processes[HUB].poll() is not None),
                    certificates=self.certificates_of(_AUDITOR),
                )
            )
            keys, self.config = find_run(self.transport, RUN, _START)
            self.transport.subscribe(keys.weights, self._hear_weights)
            self._run_id = keys.run_id
            for name in self.clients:
                self.start(name)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _hear_weights(self, message: Envelope) -> None:
        version, _ = decode_version(message.attachment, self._run_id)
        self.steps_back += version < self._version
        self._version = version
        self.published += 1

    def _kill_all(self) -> None:
        for process in self.processes.values():
            process.kill()
            process.wait()

    # ------------------------------------------------------------------ processes

    @property
    def records(self) -> list[Path]:
        """Returns the files that the actors' witnesses wrote."""
        return sorted(self.folder.glob("*.record"))

    @property
    def run(self) -> RunFolder:
        return RunFolder(self.disk.folder, RUN)

    def log(self, name: str) -> Path:
        """Returns the file with what a process has printed."""
        return self.folder / f"{name}.log"

    def address(self, name: str) -> str:
        """Returns the address at which a process finds the hub; for the hub, where it listens."""
        endpoint = self.endpoint if name == HUB else self.links[name].endpoint
        return endpoint if self.no_certificates else endpoint.replace("tcp/", "tls/")

    def certificates_of(self, name: str) -> Path | None:
        """Returns the folder of a process's certificates; None for a run without certificates."""
        return None if self.no_certificates else self.certificates.of(name)

    def _place(self, name: str) -> tuple[str, ...]:
        folder = self.certificates_of(name)
        shown = () if folder is None else ("--certificates", str(folder))
        if name == HUB:
            return ("--listen", self.address(name), *shown)
        return ("--connect", self.address(name), "--patience", _AWAY, *shown)

    def start(self, name: str) -> None:
        """Starts a process; one that ran before continues from what it left."""
        count = self.starts[name] = self.starts.get(name, 0) + 1
        again = () if count == 1 else ("--resume",)
        run = ("--run", RUN, "--runs", str(self.disk.folder), *again, *self._flags)
        if name == HUB:
            arguments = ("replay", *self._place(name), *run)
        elif name == LEARNER:
            arguments = ("learner", *self._place(name), "--threads", "1", *run, *self._goal)
        elif name == EVALUATOR:
            place = (*self._place(name), "--run", RUN, "--name", name)
            arguments = ("actors", "--evaluator", *place)
        else:
            arguments = self._actor(name, name)
        self.processes[name] = self._child(name, self.log(name), *arguments)

    def _child(self, name: str, log: Path, *arguments: str) -> Child:
        if self._start is not None and name != HUB:
            return self._start(*arguments, log=log)
        clock = () if self.clocks.missing else self.clocks.command(name)
        return Child(*clock, *arguments, log=log)

    def _actor(self, name: str, record: str) -> tuple[str, ...]:
        file = str(self.folder / f"{record}.record")
        place = (*self._place(name), "--run", RUN)
        return ("benchmarks.chaos.witness", file, *place, "--name", name)

    def double(self, name: str) -> Child:
        """Starts another actor under the name of a present one; returns it when it plays."""
        log = self.log(f"{name}-double")
        log.touch()
        said = log.stat().st_size
        double = self._child(name, log, *self._actor(name, f"{name}-double"))
        while "plays" not in log.read_text()[said:]:
            if double.poll() is not None:
                raise double.failure(f"second {name}")
            time.sleep(_POLL)
        return double

    def old_actor(self, name: str) -> subprocess.Popen[str]:
        """Starts an actor of a former version beside one of this version."""
        return self.old_version.start(*self._place(name), "--run", RUN, "--name", f"old-{name}")

    def kill(self, name: str) -> None:
        """Ends a process by SIGKILL and starts it again at once, as a supervisor would."""
        self.processes[name].kill()
        self.processes[name].wait()
        self.start(name)

    def pause(self, name: str) -> Callable[[], None]:
        """Stops a process; returns a function that lets it go on."""
        process = self.processes[name]

        def send(number: signal.Signals) -> None:
            with suppress(ProcessLookupError):  # it may have ended by itself meanwhile
                os.kill(process.pid, number)

        send(signal.SIGSTOP)
        return lambda: send(signal.SIGCONT)

    def rejoin(self, name: str) -> None:
        """Asks an actor to leave, and starts another in its place."""
        self._end(name)
        self.start(name)

    def is_refused(self, name: str) -> bool:
        """Whether the hub refuses a process's certificate, or a client refuses the hub's."""
        who = _AUDITOR if name == HUB else name
        try:
            connect(
                *(self.address(HUB), 0.0),
                role=self._roles[who],
                certificates=self.certificates_of(who),
            ).close()
        except Unreachable:
            return True
        return False

    def _end(self, name: str) -> None:
        process = self.processes[name]
        process.end(_START)
        # A process that is still importing can only leave by the signal.
        if process.returncode not in (0, -signal.SIGTERM):
            raise process.failure(name)

    def look(self) -> None:
        """Notices processes that ended by themselves, and starts them again."""
        for name, process in list(self.processes.items()):
            status = process.poll()
            if status is None:
                continue
            if status == 0 and self._goal:  # the run is over
                self.finished |= name == LEARNER
                continue
            self.ended.append(f"{name} ended with status {status}: {process.last_line()}")
            self.start(name)

    # ------------------------------------------------------------------ the work

    def stored(self) -> dict[str, int]:
        """Returns the number of acknowledged chunks of each actor."""
        return {
            name: (self.folder / f"{name}.record").read_text().count("acknowledged")
            for name in self.actors
            if (self.folder / f"{name}.record").exists()
        }

    @property
    def stored_steps(self) -> int:
        """Returns the acknowledged agent steps; the replay has at least these."""
        return self.config.stream.chunk_steps * sum(self.stored().values())

    def tests(self) -> set[RecordedTest]:
        """Returns the tests that the learner has recorded; a killed learner may lose its last."""
        return set(recorded_tests(self.run.epochs))

    def recovery(
        self, patience: float, besides: str | None = None, *, struck: str | None = None
    ) -> float | None:
        """Waits until all processes work again, or the run is finished.

        They do when each actor's next chunk is stored, new weights have come and a test is over.

        Args:
            besides: a process that cannot work and is not waited for.
            struck: the process that a fault struck. For the evaluator two tests are waited for,
                because it may have played one of them before the fault.

        Returns:
            seconds until then, or None after ``patience`` seconds.
        """
        began = time.monotonic()
        before, weights, tests = self.stored(), self.published, self.tests()
        wanted = 0 if besides in self._evaluators else len(self._evaluators)
        wanted += struck in self._evaluators
        while (waited := time.monotonic() - began) < patience:
            now = self.stored()
            learning = besides == LEARNER or self.published > weights
            playing = all(
                now.get(name, 0) > before.get(name, 0) for name in self.actors if name != besides
            )
            testing = len(self.tests() - tests) >= wanted
            if self.finished or (learning and playing and testing):
                return waited
            self.look()
            time.sleep(_POLL)
        return None

    def conclude(self) -> None:
        """Ends all processes: first the actors, which hand in their last chunks, last the replay.

        Raises:
            InputError: a process did not end well.
        """
        self.look()
        for name in (*self.actors, *self._evaluators, LEARNER, HUB):
            self._end(name)
