"""The gates: figures that tell, while a run goes on, whether the agent sees and touches at all.

In 2017 the robot's replay held black frames and nothing said so: the mean Q of a network
without biases was exactly 0, the loss stayed that of a predictor that sees nothing, and weeks
went by. Each gate here would have been red on the first day.

A gate that stays red ends the run (`learner.telemetry.gate`), but for three that only warn:

- *relative TD error*: a blind network's is 1, but that of a network which learns Pong well (350,000
  steps, best test −12.3) crept from 0.20 to 0.66 in half an hour, since the better it plays the
  rarer are rewards, and with them their variance; in a game with rare rewards it can pass 1 in
  good health. What makes it 1 for bad reasons turns other gates red too.
- *press p99 ms*: hands that are somewhat slower than they should be can still be learned with, if
  they tell where they are; those that come too late or never turn *keys as commanded* red.
- *refused chunks*: a sum over the whole run, red for ever after a single stranger's mistake.
"""

import math
from dataclasses import replace

from common.press_latency import Delay, ms_of
from common.run.config import PlayConfig
from learner.telemetry.recent_latency import LEAST_MEASURED
from learner.telemetry.status import Gate

GATES = (
    "valid frames",
    "pixel deviation",
    "max-Q deviation",
    "relative TD error",
    "keys as commanded",
    "press p99 ms",
    "refused chunks",
)
"""Names of all gates, in their order; a bare emulator has no hands for two of them."""
LEAST_VALID_FRAMES = 0.99
LEAST_PIXEL_DEVIATION = 1.0
LEAST_MAX_Q_DEVIATION = 1e-6
MOST_TD_ERROR = 1.0
LEAST_KEYS_MATCHED = 0.5
MOST_PRESS_MS = ms_of(8)
"""Two decisions, the goal of `python -m benchmarks.lab.press_latency`."""
_PRESS_FRAMES = 4
"""Emulator frames in which the arms have nearly always pressed what they are told to, p99 of
`python -m benchmarks.lab.press_latency`."""


def keys_can_follow(play: PlayConfig) -> bool:
    """Whether hands in order hold the commanded keys at the end of the same decision.

    Not where commands come late on purpose, where a decision is shorter than a press, and where
    the controller is read before the arms move: there a change of keys never matches in time.
    """
    # A modelled hand presses in the frame after those that it takes.
    press = _PRESS_FRAMES if play.hand == "arm" else play.press_latency + 1
    return play.command_latency == 0 and play.read_keys == "frame" and press <= play.frame_skip


def judge_gates(
    *,
    env: str,
    valid_frame_share: float | None,
    pixel_deviation: float | None,
    max_q_deviation: float | None,
    squared_td_error: float | None,
    reward_variance: float | None,
    press_match_share: float | None,
    press: Delay,
    play: PlayConfig,
    refused_chunks: int,
) -> tuple[Gate, ...]:
    """The gates for these figures; None stands for "not measured yet", NaN fails.

    Args:
        env: ``"robot"`` adds the gates of the hands.
        valid_frame_share: frames in which the screen was found, 0 to 1.
        pixel_deviation: mean over sampled frames of the standard deviation of a frame's pixels,
            in grey levels of 255.
        max_q_deviation: standard deviation of max-Q over the held-out states.
        squared_td_error: mean of δ² per sample. Not the loss: Huber's is half of it, and the
            2017 loss is divided by the number of actions, so both would pass a blind network.
        reward_variance: variance of the (n-step, discounted) rewards in the same samples;
            where it is 0 nothing can be said.
        press_match_share: decisions whose pressed keys were the commanded ones, 0 to 1.
        press: from a command to its keys.
        play: where keys come late on purpose, their figures are shown but not judged.
        refused_chunks: chunks that the replay refused.
    """
    relative_error = None
    if squared_td_error is not None and reward_variance:
        relative_error = squared_td_error / reward_variance
    gates = [
        _at_least(
            "valid frames",
            valid_frame_share,
            LEAST_VALID_FRAMES,
            "the screen is not found in the camera's picture",
        ),
        _above(
            "pixel deviation",
            pixel_deviation,
            LEAST_PIXEL_DEVIATION,
            "stored frames are black or of one grey",
        ),
        _above(
            "max-Q deviation",
            max_q_deviation,
            LEAST_MAX_Q_DEVIATION,
            "the network answers the same whatever it sees",
        ),
        Gate(
            name="relative TD error",
            value=relative_error,
            passed=None if relative_error is None else relative_error < MOST_TD_ERROR,
            bound=f"< {MOST_TD_ERROR:g}",
            why="the network predicts no better than one that sees nothing",
            stops=False,
        ),
    ]
    if env == "robot":
        keys = _at_least(
            "keys as commanded",
            press_match_share,
            LEAST_KEYS_MATCHED,
            "the hands do not press what the policy asks for",
        )
        prompt = _prompt(press)
        # Real hands keep their time whenever the controller is read, and however soon the next
        # command comes.
        gates += (
            keys if keys_can_follow(play) else replace(keys, passed=None),
            prompt if play.hand == "arm" else replace(prompt, passed=None),
        )
    gates.append(
        Gate(
            name="refused chunks",
            value=float(refused_chunks),
            passed=refused_chunks == 0,
            bound="= 0",
            why="actors send what the replay cannot take; their logs say what",
            stops=False,
        )
    )
    return tuple(gates)


def _prompt(press: Delay) -> Gate:
    """Open while too few were measured, or none watched for so long that it could be too late."""
    known = press.measured >= LEAST_MEASURED
    if press.p99 == math.inf:
        known &= press.watched >= MOST_PRESS_MS
    passed = press.p99 <= MOST_PRESS_MS if known and press.p99 is not None else None
    return Gate(
        name="press p99 ms",
        value=press.p99,
        passed=passed,
        bound=f"≤ {MOST_PRESS_MS:.1f}",
        why="the hands press what the policy asks for too late",
        stops=False,
    )


def _at_least(name: str, value: float | None, bound: float, why: str) -> Gate:
    passed = None if value is None else value >= bound
    return Gate(name=name, value=value, passed=passed, bound=f"≥ {bound:g}", why=why)


def _above(name: str, value: float | None, bound: float, why: str) -> Gate:
    passed = None if value is None else value > bound
    return Gate(name=name, value=value, passed=passed, bound=f"> {bound:g}", why=why)
