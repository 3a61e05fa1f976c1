"""Times the hands while they play: from each command to its keys, frame by frame.

`common.press_latency` says what is measured, and what becomes of it.
"""

from collections import deque

from common.actions import Keys
from common.press_latency import MOST_FRAMES, Goal, place_of

_KEPT = 1_024
"""Outcomes kept for those who ask. A step has two for each command at most; a person who plays
never asks."""


class KeyWatch:
    """Watches one pair of hands. It runs in every frame, hence whole numbers instead of `Keys`."""

    def __init__(self) -> None:
        self._found: deque[int] = deque(maxlen=_KEPT)
        self.restart()

    def restart(self) -> None:
        """The hands are at rest without a command, and nothing was measured yet."""
        self._found.clear()
        self._wanted = 0
        self._age = 0
        self._releasing = self._pressing = False

    def command(self, keys: Keys, held: Keys) -> None:
        """The hands are to hold ``keys`` and hold ``held``.

        The same keys once more are no new command: the first goes on being watched.
        """
        wanted, pressed = int(keys), int(held)
        if wanted == self._wanted:
            return
        self.give_up()
        self._wanted, self._age = wanted, 0
        self._releasing = pressed & ~wanted != 0
        self._pressing = wanted & ~pressed != 0

    def frame(self, felt: Keys) -> None:
        """``felt`` are pressed at the end of one more frame."""
        if not (self._releasing or self._pressing):
            return
        self._age += 1
        pressed = int(felt)
        if self._releasing and not pressed & ~self._wanted:
            self._releasing = False
            self._note("release", True)
        if self._pressing and not self._wanted & ~pressed:
            self._pressing = False
            self._note("press", True)
        if self._age == MOST_FRAMES:
            self.give_up()

    def give_up(self) -> None:
        """No longer watch for what was not reached: time ends, or another command comes."""
        if self._age:  # else nothing was seen of it
            if self._releasing:
                self._note("release", False)
            if self._pressing:
                self._note("press", False)
        self._releasing = self._pressing = False

    def take(self) -> tuple[int, ...]:
        """What was measured since the last call: `place_of` each outcome, oldest first."""
        found = tuple(self._found)
        self._found.clear()
        return found

    def _note(self, goal: Goal, reached: bool) -> None:
        self._found.append(place_of(goal, reached, self._age))
