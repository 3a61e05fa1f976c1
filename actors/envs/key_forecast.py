"""Forecast of the keys of the next frames: what is on its way to the hands, and when it arrives.

A command takes effect only after the latency of hands, network and motors, and until then the game
goes on under those before it. Whoever knows the latency knows what these will still do, and from
which frame on a choice matters (a Smith predictor has the same two things of its process). Nobody
tells it: it is found by timing the hands' own keys.
"""

import numpy as np
from numpy.typing import NDArray

from actors.envs.key_timing import KeyTiming
from common.proprioception import KEYS

FLAGS = np.array(
    [[bool(number & key) for key in KEYS] for number in range(2 ** len(KEYS))], np.float32
)
"""Which keys are in each set of keys, ``[32, 5]``."""


class KeyForecast(KeyTiming):
    """Watches one pair of hands, and tells what they will press."""

    def __init__(self, frames: int) -> None:
        """Forecast ``frames`` emulator frames at a time."""
        super().__init__()
        self._ahead = range(1, frames + 1)

    def rows(self) -> NDArray[np.float32]:
        """Returns the forecast, ``float32 [frames, 7]``, as in `common.proprioception`."""
        release, press = self.release.frames or 0, self.press.frames or 0
        past, last = self.past, len(self.past) - 1
        keys = []
        for ahead in self._ahead:
            # The hands hold what both agree on: the slower of the two is still on its way.
            by_release = past[last + ahead - release] if ahead <= release else self.wanted
            by_press = past[last + ahead - press] if ahead <= press else self.wanted
            keys.append(by_release & by_press if release <= press else by_release | by_press)
        too_late = [[ahead <= release, ahead <= press] for ahead in self._ahead]
        return np.concatenate([np.array(too_late, np.float32), FLAGS[keys]], axis=1)
