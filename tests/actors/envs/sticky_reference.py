"""Sticky actions written out, after `StellaEnvironment::act` of the Arcade Learning Environment."""

import numpy as np


class StickyActions:
    """Tells which action each emulator frame executes while others are held.

    ALE draws twice per frame, for two players, from a Mersenne Twister that its seed starts. The
    first player's action is executed unless its draw is below ``probability``.
    """

    def __init__(self, probability: float, seed: int) -> None:
        self._probability = probability
        self._twister = np.random.RandomState(seed)
        self.restart()

    def restart(self) -> None:
        """A new game, before which nothing was executed; the generator is not seeded again."""
        self._executed = 0

    def frame(self, held: int) -> int:
        """Returns the action that the next frame executes."""
        own, _ = self._twister.randint(2**32, size=2, dtype=np.uint32).tolist()
        if own / 2**32 >= self._probability:
            self._executed = held
        return self._executed
