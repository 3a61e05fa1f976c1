"""What a Ray cluster has of a run: keepers, each a Ray actor whose child is one process of the run.

A keeper ends when its process does, and Ray starts it again wherever there is room. A process ends
when its keeper does, so that none is left on a node that Ray has given up. Which keepers there are
is known to Ray alone, by their names in a namespace of the run's own.
"""

import os
import random
import socket
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import ray
from ray.exceptions import RayError

from common.process.exit_codes import BAD_INPUT
from common.process.restarts import end_with_parent
from common.process.supervisor import Child
from common.run.folder import RunFolder, append_whole
from deploy.certificates import make_certificates

LEARNER = "learner"
"""Name of the learner's keeper; those of others are their processes' names."""
_LOOK = 2.0
"""Seconds after which an actor's keeper looks after its process, and asks for the learner again."""
_PAUSE = 5.0
"""Seconds between the end of a process and that of its keeper: time to ask for the exit code, and
a pause between restarts."""
_PORTS = range(20_000, 30_000)
"""Ports of learners; neither Ray nor Linux chooses one of them by itself."""


class LearnerKeeper:
    """Keeps the learner, and tells the others where it listens.

    Args:
        folder: the run's, where all nodes find it.
        directory: the learner's working directory.
        begin: flags of the learner that begins the run.
        resume: flags of one that goes on with it.
        actor: flags of an actor.
        tls: whether the processes show each other certificates.
    """

    def __init__(
        self,
        folder: str,
        directory: str,
        begin: Sequence[str],
        resume: Sequence[str],
        actor: Sequence[str],
        tls: bool,
    ) -> None:
        run = RunFolder(Path(folder).parent, Path(folder).name)
        run.logs.mkdir(parents=True, exist_ok=True)
        log = run.logs / "learner.log"
        _await_former(run, log)  # before a port is chosen, which might be taken meanwhile
        node: str = ray.util.get_node_ip_address()  # type: ignore[no-untyped-call, unused-ignore]
        host = f"[{node}]" if ":" in node else node
        address = f"{'tls' if tls else 'tcp'}/{host}:{_free_port(node)}"
        secure = []
        if tls:
            # The authority stays; the hub's certificate is of the node that the learner has now.
            certificates = run.path / "certificates"
            make_certificates(certificates, node)
            secure = ["--certificates", str(certificates)]
        self._join = (str(run.logs), ("--connect", address, *secure, *actor))
        self._asked = False
        self._child = Child(
            *("learner", *(resume if run.replay.is_dir() else begin), "--listen", address),
            *secure,
            log=log,
            cwd=directory,
            preexec_fn=end_with_parent,  # Ray ends a keeper by SIGKILL
        )
        _in_thread(self._watch)

    def join(self) -> tuple[str, tuple[str, ...]]:
        """Returns the folder of the logs, and the flags by which an actor joins the run."""
        return self._join

    def status(self) -> int | None:
        """Returns the learner's exit code; None while it works, or is about to be started again."""
        status = self._child.poll()
        return None if status is not None and status < 0 and not self._asked else status

    def stop(self) -> int | None:
        """Asks the learner to end with a checkpoint; returns its exit code as soon as it has."""
        if not self._asked:
            self._asked = True
            self._child.terminate()
        return self._child.poll()

    def _watch(self) -> None:
        status = self._child.wait()
        if status < 0 and not self._asked:
            time.sleep(_PAUSE)
            os._exit(1)  # killed: Ray starts it again
        time.sleep(_PAUSE)
        while True:  # started again, this keeper would go on with a run that is over
            with suppress(RayError):
                for name in ray.util.list_named_actors():
                    if name != LEARNER:
                        with suppress(ValueError):
                            ray.kill(ray.get_actor(name))
                ray.kill(ray.get_actor(LEARNER))
            time.sleep(_LOOK)


class ActorKeeper:
    """Keeps an actor or evaluator, which follows the learner wherever Ray puts that.

    Args:
        name: the process' and the keeper's.
        role: flags that make it an evaluator.
    """

    def __init__(self, name: str, *role: str) -> None:
        self._name, self._role = name, role
        self._child: Child | None = None
        self._leaving = False
        _in_thread(self._keep)

    def leave(self) -> None:
        """Ends the process, which leaves the run."""
        self._leaving = True
        if self._child is not None:
            self._child.end()

    def _keep(self) -> None:
        joined: Any = None
        while not self._leaving:
            if self._child is not None and self._child.poll() is not None:
                self._ended(self._child.returncode)
            told: Any = joined
            try:
                told = ray.get(ray.get_actor(LEARNER).join.remote(), timeout=_LOOK)
            except ValueError:  # the run is over
                ray.kill(ray.get_actor(self._name))
                return
            except RayError:  # the learner is on its way
                pass
            if told is not None and told != joined:
                if self._child is not None:
                    self._child.end()
                logs, flags = joined = told
                log = Path(logs) / f"{self._name}.log"
                own = ("--name", self._name, *self._role)
                self._child = Child("actors", *flags, *own, leash=True, log=log)
            time.sleep(_LOOK)

    def _ended(self, status: int) -> None:
        if self._leaving:
            return
        if status == BAD_INPUT:  # another start would be in vain
            ray.kill(ray.get_actor(self._name))
        time.sleep(_PAUSE)
        os._exit(1)  # Ray starts it again


def _await_former(run: RunFolder, log: Path) -> None:
    """Returns once the run's former learner, which has lost its keeper, has written its checkpoint
    and ended; of one whose node has failed, once the shared disk has given up its lock."""
    if run.is_at_work():
        append_whole(log, b"The former learner is still at work: the next begins when it ends.\n")
    while run.is_at_work():
        time.sleep(_LOOK)


def _in_thread(work: Callable[[], None]) -> None:
    """Does ``work`` beside the keeper's answers; if it fails, Ray starts the keeper again."""

    def run() -> None:
        try:
            work()
        except BaseException:
            traceback.print_exc()
            time.sleep(_PAUSE)
            os._exit(1)

    threading.Thread(target=run, daemon=True).start()


def _free_port(host: str) -> int:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    for port in random.sample(_PORTS, 100):
        with socket.socket(family) as probe, suppress(OSError):
            probe.bind((host, port))
            return port
    raise OSError(f"{host} has no free port between {_PORTS.start} and {_PORTS.stop}")
