"""Tells how soon a robot's hands can press keys under the settings of play."""

from dataclasses import replace

from common.registry import ENVIRONMENTS, ROBOTS
from common.settings.conditions import PlayConfig
from common.settings.config import RunConfig
from common.settings.ranges import draw

_PRESS_FRAMES = 4
"""Emulator frames within which the arms nearly always press the commanded keys, p99 of
`python -m benchmarks.lab.press_latency`."""


def latest_play(config: RunConfig) -> PlayConfig:
    """Returns the settings of play as they take effect, with the longest latencies that may be
    drawn."""
    arms = config.play.hand == "arm" and ENVIRONMENTS.find(config.env).robot
    drawn = draw(config.play, config.camera, config.randomise, lambda: 1.0)
    # The emulator alone always has the model, and no robot plays.
    robot = drawn.play.robot if config.hands else PlayConfig.robot
    return replace(drawn.play, robot=robot, hand="arm" if arms else "model")


def keys_can_follow(play: PlayConfig) -> bool:
    """Returns whether healthy hands press the commanded keys within the same agent step.

    They cannot if commands come late on purpose, if a step is shorter than a press, if the robot is
    slow by nature, or if the controller is read before the arms move.
    """
    # A modelled hand presses in the frame after its latency.
    press = _PRESS_FRAMES if play.hand == "arm" else play.press_latency + 1
    return not is_late(play) and play.read_keys == "frame" and press <= play.frame_skip


def is_late(play: PlayConfig) -> bool:
    """Returns whether commands come late on purpose, or because the robot is slow by nature."""
    prompt = ROBOTS.find(play.robot).prompt
    return not prompt or max(play.actuation_latency, play.actuation_jitter, play.equal_latency) > 0
