"""Actuation latency: commands reach the hands some emulator frames late.

What lies between an action and a motor (network, operating system, bus) delays presses and releases
alike. The time that the hands themselves need comes on top.
"""

from collections import deque

from numpy.random import Generator

from actors.robots.interface import Hands
from common.actions import Keys


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
