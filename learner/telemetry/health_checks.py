"""Health checks: figures that tell, while a run goes on, whether the agent sees and touches at all.

In 2017 the robot's replay held black frames and nothing said so: the mean Q of a network
without biases was exactly 0, the loss stayed that of a predictor that sees nothing, and weeks
went by. Each check here would have failed on the first day.

A check that keeps failing ends the run (`learner.telemetry.gate`), but for those that only warn:

- *relative TD error*: a blind network's is 1, but that of a network which learns Pong well (350,000
  steps, best test −12.3) crept from 0.20 to 0.66 in half an hour, since the better it plays the
  rarer are rewards, and with them their variance; in a game with rare rewards it can pass 1 in
  good health. What makes it 1 for bad reasons fails other checks too.
- *press p99 ms*: hands that are somewhat slower than they should be can still be learned with, if
  they tell where they are; those that come too late or never fail *keys as commanded*.
- *refused chunks* and *excess chunks*: sums over the whole run, failed for ever after one mistake.
"""

import math
import operator
from typing import NamedTuple

from common.metrics import Values, number
from common.press_latency import ms_of
from common.registry import ENVIRONMENTS
from common.run.config import PlayConfig, RunConfig
from learner.telemetry.recent_latency import LEAST_MEASURED
from learner.telemetry.snapshot import HealthCheck

LEAST_VALID_FRAMES = 0.99
MOST_PRESS_MS = ms_of(8)
"""Two agent steps, the goal of `python -m benchmarks.lab.press_latency`."""
_PRESS_FRAMES = 4
"""Emulator frames in which the arms have nearly always pressed what they are told to, p99 of
`python -m benchmarks.lab.press_latency`."""
_HOLDS = {
    "≥": operator.ge,
    ">": operator.gt,
    "<": operator.lt,
    "≤": operator.le,
    "=": operator.eq,
}


class _Rule(NamedTuple):
    name: str
    key: str
    """The figure that is judged."""
    sign: str
    bound: float
    why: str
    stops: bool = True
    robot: bool = False
    """Only where a robot plays: a bare emulator has no hands."""
    quiet: bool = False
    """Not listed while it passes."""


# fmt: off
_RULES = (
    _Rule("valid frames", "play/valid_frame_share", "≥", LEAST_VALID_FRAMES,
          "the screen is not found in the camera's picture"),
    _Rule("pixel deviation", "learning/pixel_deviation", ">", 1.0,
          "stored frames are black or of one grey"),
    _Rule("max-Q deviation", "learning/held_out_std", ">", 1e-6,
          "the network answers the same whatever it sees"),
    _Rule("relative TD error", "learning/relative_td_error", "<", 1.0,
          "the network predicts no better than one that sees nothing", stops=False),
    _Rule("keys as commanded", "play/press_match_share", "≥", 0.5,
          "the hands do not press what the policy asks for", robot=True),
    _Rule("press p99 ms", "hands/press_p99", "≤", MOST_PRESS_MS,
          "the hands press what the policy asks for too late", stops=False, robot=True),
    _Rule("refused chunks", "stream/chunks_refused", "=", 0,
          "actors send what the replay cannot take; their logs say what", stops=False),
    _Rule("excess chunks", "stream/chunks_excess", "=", 0,
          "the replay stored chunks more than once, which are drawn too often", stops=False,
          quiet=True),
)
# fmt: on


def keys_can_follow(play: PlayConfig) -> bool:
    """Whether hands in order hold the commanded keys at the end of the same agent step.

    Not where commands come late on purpose, where a step is shorter than a press, and where
    the controller is read before the arms move: there a change of keys never matches in time.
    """
    # A modelled hand presses in the frame after those that it takes.
    press = _PRESS_FRAMES if play.hand == "arm" else play.press_latency + 1
    return play.command_latency == 0 and play.read_keys == "frame" and press <= play.frame_skip


def judge(values: Values, config: RunConfig) -> tuple[HealthCheck, ...]:
    """Returns the health checks of a run with these figures; None is open, NaN fails."""
    checks = []
    robot = ENVIRONMENTS.find(config.env).robot
    for rule in _RULES:
        value = number(values, rule.key)
        passed = None if value is None else bool(_HOLDS[rule.sign](value, rule.bound))
        if (rule.robot and not robot) or (rule.quiet and passed is not False):
            continue
        if not _can_tell(rule, values, config.play):
            passed = None
        checks.append(
            HealthCheck(
                name=rule.name,
                value=None if value is None else float(value),
                passed=passed,
                bound=f"{rule.sign} {rule.bound:.4g}",
                why=rule.why,
                stops=rule.stops,
            )
        )
    return tuple(checks)


def _can_tell(rule: _Rule, values: Values, play: PlayConfig) -> bool:
    """Whether the figure says something about the hands, and not about how keys are read."""
    if rule.name == "keys as commanded":
        return keys_can_follow(play)
    if rule.name != "press p99 ms":
        return True
    # Real hands keep their time whenever the controller is read, and however soon the next command
    # comes. Too few measured commands tell nothing, nor do those that nobody watched for long.
    measured, watched, p99 = (
        number(values, f"hands/press_{name}") or 0 for name in ("measured", "watched", "p99")
    )
    watched_enough = math.isfinite(p99) or watched >= MOST_PRESS_MS
    return play.hand == "arm" and measured >= LEAST_MEASURED and watched_enough
