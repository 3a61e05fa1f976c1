"""Actuation latency: commands reach the hands some emulator frames late.

What lies between an action and a motor (network, operating system, bus) delays presses and releases
alike. The time that the hands themselves need comes on top.
"""

from collections import deque

import numpy as np
from numpy.random import Generator

from actors.envs.key_watch import KeyWatch, WatchedHands
from actors.envs.modelled_hand import ModelledHand
from actors.robots.interface import Hands
from common.actions import Keys
from common.settings.conditions import PlayConfig


class LateCommands:
    """Implements `Hands` with other ``hands``, which get each command late.

    A command arrives ``latency`` emulator frames late, and up to ``jitter`` more, drawn uniformly
    from ``rng``. It never overtakes an earlier one.
    """

    def __init__(self, hands: Hands, latency: int, jitter: int, rng: Generator) -> None:
        self._hands = hands
        self._latency = latency
        self._jitter = jitter
        self._rng = rng
        self._forget()

    @property
    def held(self) -> Keys:
        return self._hands.held

    def rest(self) -> None:
        self._hands.rest()
        self._forget()

    def command(self, keys: Keys) -> None:
        late = int(self._rng.integers(self._jitter + 1)) if self._jitter else 0
        self._waiting.append((self._frame + self._latency + late, keys))

    def step_frame(self) -> Keys:
        while self._waiting and self._waiting[0][0] <= self._frame:
            self._hands.command(self._waiting.popleft()[1])
        self._frame += 1
        return self._hands.step_frame()

    def _forget(self) -> None:
        self._waiting: deque[tuple[int, Keys]] = deque()
        """Commands in order, each with the frame from which on it is due."""
        self._frame = 0


def hands_of(
    play: PlayConfig, arms: Hands | None, rng: Generator, watch: KeyWatch | None = None
) -> Hands:
    """Returns the hands that ``play`` asks for, with their latency.

    Args:
        arms: the robot, or a latency model. Without either (None), the hand is `ModelledHand`.
        rng: seeds the jitter; used only if there is jitter.
        watch: times the hands and is told of each command that reaches them.
    """
    latency, jitter = play.actuation_latency, play.actuation_jitter
    hands = arms
    if hands is None or play.hand == "model":
        hands = ModelledHand(play)
    if watch is not None:
        hands = WatchedHands(hands, watch)
    if latency == jitter == 0:
        return hands
    own = np.random.default_rng(rng.integers(2**63) if jitter else 0)
    return LateCommands(hands, latency, jitter, own)
