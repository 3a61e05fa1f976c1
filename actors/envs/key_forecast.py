"""Forecasts the keys of the next frames: which commands are on their way, and when they arrive.

A command takes effect only after the latency of hands, network and motors. Until then the game goes
on under earlier commands. The latency tells what these will still do, and from which frame on a
choice matters; a Smith predictor uses the same two facts about its process. The latency is found by
timing the keys and not read from the settings.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from common.actions import Keys
from common.proprioception import KEYS

LONGEST = 60
"""Number of latencies that are told apart: 0 to 59 emulator frames, just below 1 s."""
_KEEP = 0.9
"""Share of earlier votes that is kept at each change of the keys: about ten changes count."""
FLAGS = np.array(
    [[bool(number & key) for key in KEYS] for number in range(2 ** len(KEYS))], np.float32
)
"""The keys in each set of keys, by the set's bits, ``[32, 5]``."""


class _Latency:
    """The latency that most changes of the keys agree on.

    Any earlier command that asked for a change may have caused it, so a change votes for the
    latencies of all of them. The right latency is among them each time, others only by chance.
    """

    def __init__(self) -> None:
        self._votes = np.zeros(LONGEST, np.float32)
        self.frames = 0
        """Emulator frames between the frame that begins with a command and the first one that
        ends with its keys; 0 before the first change."""

    def vote(self, changed: int, wanted: list[int]) -> None:
        """Votes for the age, in frames, of each command that asked for one of the ``changed`` keys.

        ``wanted`` holds the commanded keys of each past frame.
        """
        last = len(wanted) - 1
        latencies = [
            last - frame
            for frame in range(1, len(wanted))
            if changed & wanted[frame] & ~wanted[frame - 1]
        ]
        if latencies:
            self._votes *= _KEEP
            self._votes[latencies] += 1.0
            self.frames = int(self._votes.argmax())


class KeyForecast:
    """Forecasts what one pair of hands will press, from its commands and the keys that it pressed.

    It runs in every frame and therefore uses whole numbers instead of `Keys`.
    """

    def __init__(self, frames: int) -> None:
        """Forecasts ``frames`` emulator frames at a time."""
        self._ahead = range(1, frames + 1)
        self.restart()

    def restart(self) -> None:
        """Forgets everything: other hands may play now, and they are at rest."""
        self._wanted, self._felt = 0, 0
        self._past: deque[int] = deque([0] * (LONGEST + 1), maxlen=LONGEST + 1)
        """The keys that were commanded in each of the last frames."""
        self._release, self._press = _Latency(), _Latency()

    def command(self, keys: Keys) -> None:
        """Notes that the hands are to hold ``keys`` from the next frame on."""
        self._wanted = int(keys)

    def feel(self, pressed: Keys) -> None:
        """Notes that the keys ``pressed`` are held at the end of one more frame."""
        self._past.append(self._wanted)
        felt, before = int(pressed), self._felt
        if felt == before:
            return
        self._felt = felt
        past = list(self._past)
        self._release.vote(before & ~felt, [~wanted for wanted in past])
        self._press.vote(felt & ~before, past)

    def rows(self) -> NDArray[np.float32]:
        """Returns the forecast, ``float32 [frames, 7]``, as in `common.proprioception`."""
        release, press = self._release.frames, self._press.frames
        past, last = self._past, len(self._past) - 1
        keys = []
        for ahead in self._ahead:
            # Presses take the one latency and releases the other; combined, both are respected.
            by_release = past[last + ahead - release] if ahead <= release else self._wanted
            by_press = past[last + ahead - press] if ahead <= press else self._wanted
            keys.append(by_release & by_press if release <= press else by_release | by_press)
        too_late = [[ahead <= release, ahead <= press] for ahead in self._ahead]
        return np.concatenate([np.array(too_late, np.float32), FLAGS[keys]], axis=1)
