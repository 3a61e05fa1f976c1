"""Health checks: figures that show during a run whether the agent sees and touches at all.

In 2017 the robot's replay held black frames, and nothing said so: the mean Q of a network without
biases was exactly 0, the loss stayed that of a predictor that sees nothing, and weeks went by.
Each check is a bound on a figure in `common.metrics`, and would have failed on the first day.

A check that keeps failing ends the run (`learner.health_guard`). These only warn:

- *relative TD error*: a network that answers the same to all that it sees has 1 or more, and one
  that has learned far less. But one that sees well may have 1 while it has learned nothing yet, as
  where a first reward takes long to find.
- *press p99 ms*: an agent can learn with hands that are somewhat too slow, if it is told where they
  are. Hands that press too late, or never, fail *keys as commanded*.
- *faulty environments*: in drawn worlds a healthy robot may see nothing new for a whole game, and
  of many robots there is always one. Nor may one actor end the run of all others.
- *refused chunks* and *excess chunks*: sums over the whole run, which one mistake fails for ever.
"""

import math
from collections.abc import Iterable

from common.metrics import METRICS, PRESS_MS, Values, number
from common.protocol.run_status import HealthCheck
from common.registry import ENVIRONMENTS
from common.settings.conditions import PlayConfig
from common.settings.config import RunConfig
from common.settings.hands import is_late, keys_can_follow, latest_play
from learner.telemetry.recent_latency import LEAST_MEASURED

LONGEST_SILENCE = 60.0
"""Seconds without a turn of the training loop after which the learner counts as hanging."""


def judge(values: Values, config: RunConfig) -> tuple[HealthCheck, ...]:
    """Returns the health checks of a run with these figures.

    A check is open, ``passed`` None, while its figure is unknown; NaN fails.
    """
    checks = []
    robot = ENVIRONMENTS.find(config.env).robot
    latest = latest_play(config)
    for metric in METRICS.values():
        bound, value = metric.bound, number(values, metric.key)
        if bound is None or (metric.robot and not robot):
            continue
        passed = None if value is None else bound.admits(value)
        if bound.quiet and passed is not False:
            continue
        if not _can_tell(metric.key, values, latest):
            passed = None
        checks.append(
            HealthCheck(
                name=bound.check,
                value=None if value is None else float(value),
                passed=passed,
                bound=str(bound),
                why=f"{bound.why}: {who}" if (who := values.get(bound.who)) else bound.why,
                stops=bound.stops,
            )
        )
    return tuple(checks)


def _can_tell(key: str, values: Values, play: PlayConfig) -> bool:
    """Returns whether a figure about the hands can be judged.

    Args:
        play: settings of play, as `latest_play` returns them.
    """
    if key == "play/press_match_share":
        return keys_can_follow(play)
    if key != "hands/press_p99":
        return True
    # The time of real hands depends neither on when the controller is read, nor on how soon the
    # next command comes. Few commands tell nothing, nor do commands that were watched briefly.
    measured, watched, p99 = (
        number(values, f"hands/press_{name}") or 0 for name in ("measured", "watched", "p99")
    )
    watched_enough = math.isfinite(p99) or watched >= PRESS_MS.limit
    prompt = play.hand == "arm" and not is_late(play)
    return prompt and measured >= LEAST_MEASURED and watched_enough


def hanging(silent_for: float) -> list[str]:
    """Returns the reason why the learner counts as hanging; none if the training loop works."""
    if silent_for < LONGEST_SILENCE:
        return []
    return [f"the training loop has not looked around for {silent_for:.0f} s: see its log"]


def reasons(silent_for: float, checks: Iterable[HealthCheck]) -> list[str]:
    """Returns why the learner is not healthy, in the words of `/readyz` and `ale-robot status`."""
    return hanging(silent_for) + [
        f"health check {check.name!r} is red: {check.why}"
        for check in checks
        if check.stops and check.passed is False
    ]
