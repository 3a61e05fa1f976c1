"""Keepers: Ray actors, each of which has one process of a run as its child.

A keeper ends when its process does, and Ray restarts it wherever there is room. A process ends when
its keeper does, so that none is left on a node that Ray has given up. Only Ray knows which keepers
exist, by their names in a namespace of the run.
"""

import os
import random
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

import ray
from ray.exceptions import RayError

from common.atomic_file import append_whole
from common.exit_codes import BAD_INPUT
from common.process.restarts import end_with_parent
from common.process.supervisor import Child
from common.run.folder import Part, RunFolder
from deploy.certificates import make_certificates
from deploy.description import Program
from deploy.hub_port import PORTS, free_port

LEARNER: Final = "learner"
REPLAY: Final = "replay"
"""Names of the keepers of learner and replay; other keepers have the names of their processes."""
Join = tuple[str, tuple[str, ...], tuple[str, ...]]
"""Folder of the logs, flags with which a process joins the hub, and flags of an actor."""
_LOOK = 2.0
"""Seconds after which a keeper checks its process, and asks for the hub again."""
_PAUSE = 5.0
"""Seconds between the end of a process and that of its keeper. They are the time to ask for the
exit code, and the pause between restarts."""
_LONG_PAUSE = 60.0
"""The same after an actor that ended well. Its node may be closing down; if the run's steps are all
played, it would leave at once each time, and the last tests can take many minutes."""


class _ProgramKeeper:
    """Keeps a learner or a replay, whose end is the end of the run.

    Args:
        folder: the run's folder, which all nodes share.
        directory: the process' working directory.
        program: the process.
    """

    def __init__(self, folder: str, directory: str, program: Program) -> None:
        self._run = run = RunFolder(Path(folder).parent, Path(folder).name)
        run.logs.mkdir(parents=True, exist_ok=True)
        self._log = run.logs / f"{program.module}.log"
        self._directory, self._program = directory, program
        self._asked = False
        self._child: Child | None = None

    def status(self) -> int | None:
        """Returns the exit code; None while the process works, or is about to be restarted."""
        status = None if self._child is None else self._child.poll()
        return None if status is not None and status < 0 and not self._asked else status

    def stop(self) -> int | None:
        """Asks the process to end, a learner with a checkpoint. Returns its exit code, or None if
        it has not ended yet."""
        if not self._asked:
            self._asked = True
            if self._child is None:
                _in_thread(end_run)
            else:
                self._child.terminate()
        return None if self._child is None else self._child.poll()

    def _start(self, *place: str) -> None:
        program = self._program
        begun = (self._run.path / program.begun).exists()
        self._child = Child(
            *(program.module, *(program.resume if begun else program.begin), *place),
            log=self._log,
            cwd=self._directory,
            preexec_fn=end_with_parent,  # Ray ends a keeper by SIGKILL
        )

    def _await_former(self) -> None:
        """Waits until the former process, which has lost its keeper, has saved its state and ended.
        If its node has failed, waits until the shared disk has released its lock."""
        part: Part = "replay" if self._program.module == "replay" else "learner"
        if self._run.is_at_work(part):
            told = f"The former {part} is still at work: the next one starts when it ends.\n"
            append_whole(self._log, told.encode())
        while self._run.is_at_work(part):
            time.sleep(_LOOK)

    def _ended(self, status: int) -> None:
        time.sleep(_PAUSE)
        if status < 0 and not self._asked:
            os._exit(1)  # it was killed: Ray restarts this keeper
        end_run()


class HubKeeper(_ProgramKeeper):
    """Keeps the run's hub, a learner or a separate replay, and tells others where it listens.

    Args:
        actor: flags of an actor.
        tls: whether the processes use certificates.
    """

    def __init__(
        self, folder: str, directory: str, program: Program, actor: Sequence[str], tls: bool
    ) -> None:
        super().__init__(folder, directory, program)
        self._await_former()  # first: a port chosen before might be taken meanwhile
        node: str = ray.util.get_node_ip_address()  # type: ignore[no-untyped-call, unused-ignore]
        host = f"[{node}]" if ":" in node else node
        port = free_port(node, random.randrange(len(PORTS)))
        address = f"{'tls' if tls else 'tcp'}/{host}:{port}"
        secure: tuple[str, ...] = ()
        if tls:
            # The authority stays; the hub's certificate must be for its present node.
            certificates = self._run.path / "certificates"
            make_certificates(certificates, node)
            secure = ("--certificates", str(certificates))
        self._join = (str(self._run.logs), ("--connect", address, *secure), tuple(actor))
        self._start("--listen", address, *secure)
        _in_thread(self._watch)

    def join(self) -> Join:
        """Returns how processes join the hub; see `Join`."""
        return self._join

    def _watch(self) -> None:
        assert self._child is not None
        self._ended(self._child.wait())


class LearnerKeeper(_ProgramKeeper):
    """Keeps a learner that joins a replay, and follows the replay wherever Ray puts it."""

    def __init__(self, folder: str, directory: str, program: Program) -> None:
        super().__init__(folder, directory, program)
        _in_thread(self._keep)

    def _keep(self) -> None:
        self._await_former()
        joined: Join | None = None
        while not (self._asked and self._child is None):
            if self._child is not None and (status := self._child.poll()) is not None:
                self._ended(status)
                return
            told = _ask(REPLAY) or joined
            if told is not None and told != joined and not self._asked:
                if self._child is not None:
                    self._child.end()
                _, place, _ = joined = told
                self._start(*place)
            time.sleep(_LOOK)


class ActorKeeper:
    """Keeps an actor or evaluator, which follows the hub wherever Ray puts it.

    Args:
        name: name of the process and of the keeper.
        hub: name of the hub's keeper.
        role: flags that make it an evaluator.
    """

    def __init__(self, name: str, hub: str, *role: str) -> None:
        self._name, self._hub, self._role = name, hub, role
        self._child: Child | None = None
        self._leaving = False
        _in_thread(self._keep)

    def leave(self) -> None:
        """Ends the process, so that it leaves the run."""
        self._leaving = True
        if self._child is not None:
            self._child.end()

    def _keep(self) -> None:
        joined: Join | None = None
        while not self._leaving:
            if self._child is not None and self._child.poll() is not None:
                self._ended(self._child.returncode)
            told = joined
            try:
                told = _ask(self._hub) or joined
            except ValueError:  # the run is over
                ray.kill(ray.get_actor(self._name))
                return
            if told is not None and told != joined:
                if self._child is not None:
                    self._child.end()
                logs, place, flags = joined = told
                log = Path(logs) / f"{self._name}.log"
                own = ("--name", self._name, *self._role)
                self._child = Child("actors", *place, *flags, *own, leash=True, log=log)
            time.sleep(_LOOK)

    def _ended(self, status: int) -> None:
        if self._leaving:
            return
        if status == BAD_INPUT:  # another start cannot help
            ray.kill(ray.get_actor(self._name))
        time.sleep(_PAUSE if status else _LONG_PAUSE)
        os._exit(1)  # Ray restarts this keeper


def end_run() -> None:
    """Ends all keepers in this namespace, and so their processes.

    The learner's keeper ends after the others, which learn from it whether the run is over. The
    caller's own keeper ends last.
    """
    own = ray.get_runtime_context().get_actor_name()
    while True:  # a restarted keeper would continue a run that is over
        with suppress(RayError):
            names = ray.util.list_named_actors()
            for name in sorted(names, key=lambda each: (each == own, each == LEARNER)):
                with suppress(ValueError):
                    ray.kill(ray.get_actor(name))
            if not names:
                return
        time.sleep(_LOOK)


def _ask(hub: str) -> Join | None:
    """Asks the hub's keeper how to join; returns None while the keeper starts. Raises ValueError if
    there is no such keeper."""
    try:
        told: Join = ray.get(ray.get_actor(hub).join.remote(), timeout=_LOOK)
    except RayError:
        return None
    return told


def _in_thread(work: Callable[[], None]) -> None:
    """Does ``work`` in a thread, while the keeper answers; if it fails, Ray restarts the keeper."""

    def run() -> None:
        try:
            work()
        except BaseException:
            traceback.print_exc()
            time.sleep(_PAUSE)
            os._exit(1)

    threading.Thread(target=run, daemon=True).start()
