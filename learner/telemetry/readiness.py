"""Why a run is not as it should be, in words: for `/readyz` and for `ale-robot status`."""

from collections.abc import Iterable

from common.protocol.run_status import HealthCheck

LONGEST_SILENCE = 60.0
"""Seconds without a look of the training loop after which the learner counts as hanging."""


def hanging(silent_for: float) -> list[str]:
    """Returns the reason if the training loop hangs; none if it goes round."""
    if silent_for < LONGEST_SILENCE:
        return []
    return [f"the training loop has not looked around for {silent_for:.0f} s: see its log"]


def reasons(silent_for: float, checks: Iterable[HealthCheck]) -> list[str]:
    """Returns why the learner is not in good health; none if it is."""
    return hanging(silent_for) + [
        f"health check {check.name!r} is red: {check.why}"
        for check in checks
        if check.stops and check.passed is False
    ]
