"""`python -m benchmarks.flood`: how much one client with a certificate can slow a training.

A learner, which is its own hub, and one actor train Catch with certificates. There are three kinds
of turns:

* learner and actor run alone;
* another client with a certificate of its own floods them with valid chunks as fast as it can, with
  heartbeats and with requests for the newest weights;
* a busy process runs beside them and sends nothing.

Each turn is a run of its own, because a flood's steps stay in the replay. The rate is the learner's
own figure: updates by its clock. All processes share one machine, so the busy process takes as many
cores as the flooder took, and the cost of the flood is given relative to that.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks import catch
from benchmarks.child import Helper, cpu_seconds, scratch, stat_of
from benchmarks.hosted_run import RUN, HostedRun
from benchmarks.pace import Spread, in_turns
from benchmarks.report import BenchmarkOptions, Report, Seconds, Table, main
from common.checked import FromOne
from common.errors import InputError, MessageError
from common.process.supervisor import Child
from common.protocol.actor_stats import ActorStats
from common.protocol.run_status import RunStatus
from common.transport.flood_guard import CUT_OFF
from common.transport.interface import Envelope, Unanswered
from common.transport.leaky_bucket import ACTOR_QUOTA
from deploy.certificates import certify_actors

ALONE, FLOODED, BUSY = "alone", "flooded", "beside a busy process"
_ACTOR, _FLOODER = "actor-1", "flooder"
_PATIENCE = 120.0
_DEADLINE = 5.0
_POLL = 0.1
_NEVER = str(10**9)
_BUSY = "measure on a machine that is less busy."
FLAGS = (
    *("--env", "catch", "--preset", "fast", "--learning.network", "nips", "--threads", "1"),
    # One update for each step, so that the learner limits the run.
    *("--learning.batch-size", "32", "--learning.train-period", "1"),
    *("--learning.publish-period", "50", "--protocol.epoch-steps", _NEVER),
    *("--replay.capacity", "20000", "--replay.learning-starts", "300"),
    *("--replay.ratio-tolerance", "2048", "--protocol.held-out-states", "64"),
)


@dataclass(frozen=True)
class Options(BenchmarkOptions):
    """Flood a training from a client with a certificate, and measure how much slower it becomes."""

    turns: FromOne = 4
    """Number of runs of each kind."""
    seconds: Seconds = CUT_OFF
    """Length of the measurement in each run, in seconds; by default until the hub hears the flooder
    again."""
    quota: FromOne = ACTOR_QUOTA
    """Steps per second that the hub accepts from one actor (--actor-quota)."""
    settle: Seconds = 10.0
    """Seconds of training, or of training under the flood, before the measurement. A flood first
    fills the room that the limiter leaves."""


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
        actor = Child("actors", *place, "--name", _ACTOR, log=self.folder / "actor.log")
        stack.callback(actor.end)
        self.children["actor"] = actor

    def _hear(self, message: Envelope) -> None:
        stats = ActorStats.decode(message.payload)
        if stats.name == _FLOODER:
            self._heartbeats += 1
        else:
            self._actor = stats.steps, stats.seconds

    def flood(self) -> Helper:
        """Returns a flooder at work."""
        flooder = Helper(
            "the flooder",
            "benchmarks.flood_client",
            **{"connect_to": self.endpoint, "run": RUN, "name": _FLOODER},
            certificates=str(self._folder),
        )
        flooder.ask("flood")
        return flooder

    def await_flood(self) -> None:
        """Wait until the flood is more than the hub accepts.

        Raises:
            InputError: a process ended, or the flood is within the flooder's quota.
        """
        deadline = time.monotonic() + _PATIENCE
        while not (self._values()["stream/over_quota"] and self._heartbeats):
            if time.monotonic() > deadline:
                raise InputError(f"the flood is within the quota: {_BUSY}")

    def await_seconds(self, seconds: float) -> None:
        """Wait until the run has trained for ``seconds`` more by the learner's clock.

        Raises:
            InputError: a process ended, or the learner does not train.
        """
        since = self._values()["run/seconds"]
        deadline = time.monotonic() + _PATIENCE + seconds
        while self._values()["run/seconds"] < since + seconds:
            if time.monotonic() > deadline:
                raise InputError(f"the learner did not train for {seconds:g} s: {_BUSY}")

    def _values(self) -> Mapping[str, Any]:
        """Wait until the learner trains; returns its figures.

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


def measure_turn(
    options: Options, certificates: Path, *, flooded: bool = False, busy: float = 0.0
) -> dict[str, float]:
    """Returns the rates of one run, per second, and of the flood if there was one.

    Args:
        busy: cores that a process beside it takes.

    Raises:
        InputError: a process failed and printed why.
    """
    with ExitStack() as stack:
        run = stack.enter_context(Training(options.quota, certificates))
        run.await_seconds(options.settle)
        beside = None
        if flooded:
            beside = stack.enter_context(run.flood())
            run.await_flood()
        elif busy:
            beside = Helper("the busy process", "benchmarks.busy", cores=busy)
            stack.enter_context(beside)
        run.await_seconds(options.settle)
        first = run.mark(beside)
        run.await_seconds(options.seconds)
        last = run.mark(beside)
        if flooded and beside is not None:
            beside.ask("stop")
        run.check()
    return rates(first, last)


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


def measure(options: Options) -> Report:
    with scratch() as folder, catch.installed(folder):
        certificates = folder / "certificates"
        certify_actors(certificates, "localhost", (_ACTOR, _FLOODER))
        turn = partial(measure_turn, options, certificates)
        floods: list[dict[str, float]] = []

        def flooded() -> dict[str, float]:
            floods.append(turn(flooded=True))
            return floods[-1]

        kinds: dict[str, Callable[[], dict[str, float]]]
        kinds = {ALONE: turn, FLOODED: flooded, BUSY: lambda: turn(busy=floods[-1]["cpu"])}
        return report(in_turns(kinds, options.turns, warm_up=0, tell=True))


def report(found: Mapping[str, Sequence[dict[str, float]]]) -> Report:
    """Returns the report of all turns of each kind; turns of the same number are compared."""
    rows = []
    for kind, turns in found.items():
        updates = Spread.of([each["updates"] for each in turns])
        rows.append(
            {
                "training": kind,
                "updates/s": updates.median,
                "least": updates.least,
                "most": updates.most,
                "of alone": _ratio(turns, found[ALONE]).median,
                "actor's steps/s": _median(turns, "agent_steps"),
                "learner's cores": _median(turns, "learner_cores"),
                "cores beside": _median(turns, "cpu"),
            }
        )
    ratio, refusals = _ratio(found[FLOODED], found[BUSY]), _refusals(found[FLOODED])
    title = (
        f"Training of Catch beside one certified client that floods its hub, {len(found[ALONE])} "
        "turns each"
    )
    return Report(
        [Table(title, rows), Table("What the flood sent, and the hub refused", refusals)],
        {
            **{"title": title, "ratio": ratio._asdict(), "turns": found},
            **{"rows": rows, "refusals": refusals},
        },
        (
            f"Updates/s under the flood, of those beside a process that takes as many cores and "
            f"sends nothing: {ratio.median:.3f} ({ratio.least:.3f} to {ratio.most:.3f}, turn by "
            "turn).",
        ),
    )


def _ratio(turns: Sequence[dict[str, float]], others: Sequence[dict[str, float]]) -> Spread:
    """Returns the updates of ``turns`` as a share of those of ``others``, turn by turn."""
    pairs = zip(turns, others, strict=True)
    return Spread.of([some["updates"] / other["updates"] for some, other in pairs])


def _median(turns: Sequence[dict[str, float]], name: str) -> float:
    return float(np.median([each.get(name, 0.0) for each in turns]))


def _refusals(turns: Sequence[dict[str, float]]) -> list[dict[str, Any]]:
    """Returns a row for each kind of message: how many per second the flooder sent and the hub
    accepted."""
    size = f"{_median(turns, 'chunk bytes') / 1e6:.0f} MB/s"
    rows = []
    for kind, taken, why in (
        ("chunks", "chunks stored", f"{size}; over quota or turn"),
        ("heartbeats", "heartbeats_heard", "too often"),
        ("requests", "requests answered", "too often"),
    ):
        sent, took = _median(turns, kind), _median(turns, taken)
        rows.append(
            {
                **{"message": kind, "sent/s": sent, "taken/s": took},
                "refused": 1 - took / sent if sent else None,
                "why": why,
            }
        )
    return rows


if __name__ == "__main__":
    main("flood", Options, measure)
