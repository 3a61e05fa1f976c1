"""The hands that the settings of play ask for: a robot's or a model's, watched, and late."""

import numpy as np
from numpy.random import Generator

from actors.envs.key_watch import KeyWatch, WatchedHands
from actors.envs.late_commands import LateCommands
from actors.envs.modelled_hand import ModelledHand
from actors.robots.interface import Hands
from common.settings.conditions import PlayConfig


def hands_of(
    play: PlayConfig, own: Hands | None, rng: Generator, watch: KeyWatch | None = None
) -> Hands:
    """Returns the hands that ``play`` asks for, with their latency.

    Args:
        own: the robot, or a latency model. Without either (None), the hand is `ModelledHand`.
        rng: seeds the jitter; used only if there is jitter.
        watch: times the hands and is told of each command that reaches them.
    """
    latency, jitter = play.actuation_latency, play.actuation_jitter
    hands = own
    if hands is None or play.hand == "model":
        hands = ModelledHand(play)
    if watch is not None:
        hands = WatchedHands(hands, watch)
    if latency == jitter == 0:
        return hands
    jitters = np.random.default_rng(rng.integers(2**63) if jitter else 0)
    return LateCommands(hands, latency, jitter, jitters)
