"""Health checks: figures that tell, while a run goes on, whether the agent sees and touches at all.

In 2017 the robot's replay held black frames and nothing said so: the mean Q of a network
without biases was exactly 0, the loss stayed that of a predictor that sees nothing, and weeks
went by. Each check, a bound on a figure in `common.metrics`, would have failed on the first day.

A check that keeps failing ends the run (`learner.health_guard`), but for those that only warn:

- *relative TD error*: a blind network's is 1, but that of a network which learns Pong well (350,000
  steps, best test −12.3) crept from 0.20 to 0.66 in half an hour, since the better it plays the
  rarer are rewards, and with them their variance; in a game with rare rewards it can pass 1 in
  good health. What makes it 1 for bad reasons fails other checks too.
- *press p99 ms*: hands that are somewhat slower than they should be can still be learned with, if
  they tell where they are; those that come too late or never fail *keys as commanded*.
- *refused chunks* and *excess chunks*: sums over the whole run, failed for ever after one mistake.
"""

import math
from collections.abc import Iterable
from dataclasses import replace

from common.metrics import METRICS, PRESS_MS, Values, number
from common.protocol.run_status import HealthCheck
from common.registry import ENVIRONMENTS, ROBOTS
from common.run.conditions import PlayConfig
from common.run.config import RunConfig
from learner.telemetry.recent_latency import LEAST_MEASURED

LONGEST_SILENCE = 60.0
"""Seconds without a look of the training loop after which the learner counts as hanging."""
_PRESS_FRAMES = 4
"""Emulator frames in which the arms have nearly always pressed what they are told to, p99 of
`python -m benchmarks.lab.press_latency`."""


def keys_can_follow(play: PlayConfig) -> bool:
    """Whether hands in order hold the commanded keys at the end of the same agent step.

    Not where commands come late on purpose, where a step is shorter than a press, where the robot
    is slow by nature, and where the controller is read before the arms move: there a change of keys
    never matches in time.
    """
    # A modelled hand presses in the frame after those that it takes.
    press = _PRESS_FRAMES if play.hand == "arm" else play.press_latency + 1
    return not _is_late(play) and play.read_keys == "frame" and press <= play.frame_skip


def _is_late(play: PlayConfig) -> bool:
    """Whether commands come late on purpose, or by the robot's nature."""
    prompt = ROBOTS.find(play.robot).prompt
    return not prompt or max(play.actuation_latency, play.actuation_jitter, play.equal_latency) > 0


def judge(values: Values, config: RunConfig) -> tuple[HealthCheck, ...]:
    """Returns the health checks of a run with these figures; None is open, NaN fails."""
    checks = []
    robot = ENVIRONMENTS.find(config.env).robot
    latest = replace(
        config.play,
        press_latency=config.play.press_latency + config.randomise.press_latency,
        actuation_latency=config.play.actuation_latency + config.randomise.latency,
        actuation_jitter=config.play.actuation_jitter + config.randomise.jitter,
    )
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
                why=bound.why,
                stops=bound.stops,
            )
        )
    return tuple(checks)


def _can_tell(key: str, values: Values, play: PlayConfig) -> bool:
    """Whether the figure says something about the hands, whose commands come as late as in
    ``play`` at most, and not about how keys are read."""
    if key == "play/press_match_share":
        return keys_can_follow(play)
    if key != "hands/press_p99":
        return True
    # Real hands keep their time whenever the controller is read, and however soon the next command
    # comes. Too few measured commands tell nothing, nor do those that nobody watched for long.
    measured, watched, p99 = (
        number(values, f"hands/press_{name}") or 0 for name in ("measured", "watched", "p99")
    )
    watched_enough = math.isfinite(p99) or watched >= PRESS_MS.limit
    prompt = play.hand == "arm" and not _is_late(play)
    return prompt and measured >= LEAST_MEASURED and watched_enough


def hanging(silent_for: float) -> list[str]:
    """Returns the reason if the training loop hangs; none if it goes round."""
    if silent_for < LONGEST_SILENCE:
        return []
    return [f"the training loop has not looked around for {silent_for:.0f} s: see its log"]


def reasons(silent_for: float, checks: Iterable[HealthCheck]) -> list[str]:
    """Returns why the learner is not in good health, as `/readyz` and `ale-robot status` say it."""
    return hanging(silent_for) + [
        f"health check {check.name!r} is red: {check.why}"
        for check in checks
        if check.stops and check.passed is False
    ]
