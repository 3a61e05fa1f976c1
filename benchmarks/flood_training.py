"""`Training`: a learner, which is its own hub, and one actor, for `benchmarks.flood`."""

import time
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.child import Helper, cpu_seconds, stat_of
from benchmarks.hosted_run import NEVER, RUN, HostedRun
from common.errors import InputError, MessageError
from common.process.supervisor import Child
from common.protocol.actor_stats import ActorStats
from common.protocol.run_status import RunStatus
from common.transport.interface import Envelope, Unanswered

ACTOR, FLOODER = "actor-1", "flooder"
_PATIENCE = 120.0
_DEADLINE = 5.0
_POLL = 0.1
_BUSY = "measure on a machine that is less busy."
FLAGS = (
    *("--env", "catch", "--preset", "fast", "--learning.network", "nips", "--threads", "1"),
    # One update for each step, so that the learner limits the run.
    *("--learning.batch-size", "32", "--learning.train-period", "1"),
    *("--learning.publish-period", "50", "--protocol.epoch-steps", str(NEVER)),
    *("--replay.capacity", "20000", "--replay.learning-starts", "300"),
    *("--replay.ratio-tolerance", "2048", "--protocol.held-out-states", "64"),
)


class Mark(NamedTuple):
    """The run at one moment."""

    values: Mapping[str, Any]
    """The learner's own figures."""
    at: float
    """Monotonic seconds."""
    cpu: float
    """Seconds of processor time of the learner, which is the hub."""
    actor: tuple[int, float]
    """Agent steps of the actor and seconds since its start, by its last heartbeat."""
    heartbeats: int
    """Heartbeats of the flooder that the hub passed on."""
    sent: Mapping[str, float]
    """The flooder's counts and its processor time."""


class Training(HostedRun):
    """A learner and an actor; a context manager that ends them."""

    def __init__(self, quota: int, certificates: Path) -> None:
        super().__init__(
            *("learner", *FLAGS, "--actor-quota", str(quota)), certificates=certificates
        )
        self._folder = certificates
        self._actor, self._heartbeats = (0, 0.0), 0  # a thread of Zenoh's changes them

    def _watch(self, stack: ExitStack) -> None:
        self.transport.subscribe(self.keys.stats("actor", "*"), self._hear)
        self._status = self.transport.requester(self.keys.status, _DEADLINE)
        place = ("--connect", self.endpoint, "--certificates", str(self._folder))
        actor = Child("actors", *place, "--name", ACTOR, log=self.folder / "actor.log")
        stack.callback(actor.end)
        self.children["actor"] = actor

    def _hear(self, message: Envelope) -> None:
        stats = ActorStats.decode(message.payload)
        if stats.name == FLOODER:
            self._heartbeats += 1
        else:
            self._actor = stats.steps, stats.seconds

    def flood(self) -> Helper:
        """Returns a flooder at work."""
        flooder = Helper(
            "the flooder",
            "benchmarks.flood_client",
            **{"connect_to": self.endpoint, "run": RUN, "name": FLOODER},
            certificates=str(self._folder),
        )
        flooder.ask("flood")
        return flooder

    def await_flood(self) -> None:
        """Waits until the flood is more than the hub accepts.

        Raises:
            InputError: a process ended, or the flood is within the flooder's quota.
        """
        deadline = time.monotonic() + _PATIENCE
        while not (self._values()["stream/over_quota"] and self._heartbeats):
            if time.monotonic() > deadline:
                raise InputError(f"the flood is within the quota: {_BUSY}")

    def await_seconds(self, seconds: float) -> None:
        """Waits until the run has trained for ``seconds`` more by the learner's clock.

        Raises:
            InputError: a process ended, or the learner does not train.
        """
        since = self._values()["run/seconds"]
        deadline = time.monotonic() + _PATIENCE + seconds
        while self._values()["run/seconds"] < since + seconds:
            if time.monotonic() > deadline:
                raise InputError(f"the learner did not train for {seconds:g} s: {_BUSY}")

    def _values(self) -> Mapping[str, Any]:
        """Waits until the learner trains; returns its figures.

        Raises:
            InputError: a process ended, or the learner does not begin to train.
        """
        deadline = time.monotonic() + _PATIENCE
        while time.monotonic() < deadline:
            time.sleep(_POLL)  # a hub drops requests that come too fast
            self.check()
            with suppress(MessageError, Unanswered):  # it is still starting
                told = RunStatus.decode(self._status.request(b"").result().payload)
                if told.values["learning/updates"]:
                    return told.values
        raise InputError(
            f"the learner did not report that it trains within {_PATIENCE:g} s: see its log."
        )

    def mark(self, beside: Helper | None) -> Mark:
        """Returns the present state of the run, with the counts of the process beside it."""
        values, pid = self._values(), self.process.pid
        sent = {} if beside is None else beside.ask("counts")
        spent = cpu_seconds(stat_of(pid))
        return Mark(values, time.monotonic(), spent, self._actor, self._heartbeats, sent)


def rates(first: Mark, last: Mark) -> dict[str, float]:
    """Returns the rates between two marks, per second.

    Updates are by the learner's clock, agent steps by the actor's, the rest by this process's.
    """
    seconds = last.at - first.at
    steps, played = (now - before for now, before in zip(last.actor, first.actor, strict=True))

    def told(key: str) -> float:
        return float(last.values[key]) - float(first.values[key])

    found = {
        "updates": told("learning/updates") / told("run/seconds"),
        "agent_steps": steps / played if played else 0.0,
        "learner_cores": (last.cpu - first.cpu) / seconds,
        "over_quota": told("stream/over_quota") / seconds,
        "refused": told("stream/chunks_refused") / seconds,
        "heartbeats_heard": (last.heartbeats - first.heartbeats) / seconds,
    }
    return found | {
        name: (count - first.sent.get(name, 0)) / seconds for name, count in last.sent.items()
    }
