"""One latency for all hands: quick ones get their commands later.

A policy plays well at the latency that it learned with, and a few emulator frames more or less cost
it the game. What cannot be made quicker can be waited for: each command is held back until the
hands, whose keys are timed, take exactly as long as the slowest ones that are expected. A receiver
of speech does the same with packets that come after different times (a playout buffer).
"""

from collections import deque

from actors.envs.key_timing import KeyTiming
from actors.robots.interface import Hands
from common.actions import Keys


class LatencyEqualiser:
    """Implements `Hands` by others, which begin to follow a command ``latency`` emulator frames
    after what was seen when it was given; later where they need longer by themselves.

    How long they take from their first change of keys to the last one remains their own. Until they
    changed a key nothing is known of them, and commands go on at once.
    """

    def __init__(self, hands: Hands, latency: int) -> None:
        self.seen_late = 0
        """Emulator frames by which the eye's pictures are late."""
        self._hands = hands
        self._latency = latency
        self._timing = KeyTiming()
        self._forget()

    @property
    def held(self) -> Keys:
        return self._hands.held

    def rest(self) -> None:
        self._hands.rest()
        self._timing.restart()
        self._forget()

    def command(self, keys: Keys) -> None:
        self._waiting.append((self._frame, keys))

    def step_frame(self) -> Keys:
        # What waits is timed by what is known now, so that all keep their distances.
        newest = self._frame - self._spare
        while self._waiting and self._waiting[0][0] <= newest:
            keys = self._waiting.popleft()[1]
            self._hands.command(keys)
            self._timing.command(keys)
        self._frame += 1
        felt = self._hands.step_frame()
        self._timing.feel(felt)
        return felt

    @property
    def _spare(self) -> int:
        """Emulator frames by which the hands are too quick; none or less where they are slow."""
        own = (self._timing.release.frames, self._timing.press.frames)
        known = [frames for frames in own if frames is not None]
        return self._latency - self.seen_late - min(known) if known else 0

    def _forget(self) -> None:
        self._waiting: deque[tuple[int, Keys]] = deque()
        """Commands in order, each with the frame that it was given for."""
        self._frame = 0
