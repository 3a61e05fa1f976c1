"""Answers requests for the run's status (`ale-robot status`)."""

import time

from common.checked import MAX_COUNT, MAX_TEXT
from common.errors import MessageError
from common.metrics import Value, number
from common.protocol.run_keys import RunKeys
from common.protocol.run_status import MAX_ACTORS, ActorStatus, RunStatus
from common.schedule import Now
from common.transport.interface import Request, Transport
from common.version import VERSION
from learner.telemetry.sinks.sink import LatestSink
from learner.telemetry.snapshot import ActorView, Snapshot


class StatusSink(LatestSink):
    """Serves the latest snapshot as a `RunStatus` until ``transport`` is closed."""

    def __init__(self, transport: Transport, keys: RunKeys, now: Now = time.monotonic) -> None:
        super().__init__(now)
        transport.serve(keys.status, self._answer)

    def _answer(self, _: Request) -> bytes:
        if self._latest is None:
            raise MessageError("the learner is starting")
        return status_of(self._latest, self._silent_for()).encode()


def status_of(snapshot: Snapshot, silent_for: float) -> RunStatus:
    """Returns the status message of ``snapshot``."""
    newest = int(number(snapshot.values, "stream/weights_version") or 0)
    return RunStatus(
        VERSION,
        silent_for,
        {key: _brief(value) for key, value in snapshot.values.items()},
        snapshot.checks,
        tuple(_of_actor(each, newest) for each in snapshot.present[:MAX_ACTORS]),
    )


def _of_actor(actor: ActorView, newest: int) -> ActorStatus:
    known = vars(actor.stats) | vars(actor)
    # An evaluator has no lag: its weights are those of a test.
    known["lag"] = max(newest - actor.stats.weights_version, 0) if known["role"] == "actor" else 0
    return ActorStatus(**{name: known[name] for name in ActorStatus._fields})


def _brief(value: Value) -> Value:
    """Returns a figure within the bounds of a message, which sums over actors may exceed."""
    if isinstance(value, str):
        return value[:MAX_TEXT]
    return min(value, MAX_COUNT) if isinstance(value, int) else value
