"""Latency of the hands, found by timing their own keys: nobody tells it."""

from collections import deque

import numpy as np

from common.actions import Keys

LONGEST = 60
"""Latencies that are told apart: 0 to 59 emulator frames, just below 1 s."""
_KEEP = 0.9
"""Share of earlier votes that is kept at each change of the keys: some ten changes count."""


class _Latency:
    """The latency that most changes of the keys agree on.

    A change may come of each earlier command that asked for it, and votes for the latency of every
    one of them. The right one is among them each time, the others only by chance.
    """

    def __init__(self) -> None:
        self._votes = np.zeros(LONGEST, np.float32)
        self.frames: int | None = None
        """Emulator frames between the frame that begins with a command and the first one that
        ends with its keys; None before the first change."""

    def vote(self, latencies: list[int]) -> None:
        if latencies:
            self._votes *= _KEEP
            self._votes[latencies] += 1.0
            self.frames = int(self._votes.argmax())


class KeyTiming:
    """Watches one pair of hands: what they were told, and what they press.

    It runs in every frame, hence whole numbers instead of `Keys`.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Other hands may play: nothing is known of them, and they are at rest."""
        self.wanted, self._felt = 0, 0
        self.past: deque[int] = deque([0] * (LONGEST + 1), maxlen=LONGEST + 1)
        """The keys that were commanded in each of the last frames."""
        self.release, self.press = _Latency(), _Latency()

    def command(self, keys: Keys) -> None:
        """The hands are to hold ``keys`` from the next frame on."""
        self.wanted = int(keys)

    def feel(self, pressed: Keys) -> None:
        """``pressed`` are held at the end of one more frame."""
        self.past.append(self.wanted)
        felt, before = int(pressed), self._felt
        if felt == before:
            return
        self._felt = felt
        past = list(self.past)
        self.release.vote(_latencies(before & ~felt, [~wanted for wanted in past]))
        self.press.vote(_latencies(felt & ~before, past))


def _latencies(changed: int, wanted: list[int]) -> list[int]:
    """Returns how many frames ago a command asked for one of the changed keys, once for each."""
    last = len(wanted) - 1
    return [
        last - frame
        for frame in range(1, len(wanted))
        if changed & wanted[frame] & ~wanted[frame - 1]
    ]
