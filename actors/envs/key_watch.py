"""Times the hands while they play: from each command to its keys, frame by frame.

`common.press_latency` says what is measured, and what becomes of it. A command that waits before it
reaches the hands is watched from when it was given, but not given up for those that come behind it.
"""

from collections import deque

from actors.robots.interface import Hands
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
        self._frame = 0
        self._given: deque[int] = deque()
        """Frames in which the commands were given that have not reached the hands."""
        self._wanted = 0
        self._age = 0
        self._tried = False
        """Whether a frame has passed since the hands got the command."""
        self._releasing = self._pressing = False

    def give(self, ago: int = 0) -> None:
        """A command sets out for the hands, which get all commands in the order of their giving; or
        did so some emulator frames ``ago``."""
        self._given.append(self._frame - ago)

    def command(self, keys: Keys, held: Keys) -> None:
        """The oldest command on its way reaches the hands: they are to hold ``keys``, and hold
        ``held``.

        The same keys once more are no new command: the first goes on being watched.
        """
        age = self._frame - self._given.popleft()
        wanted, pressed = int(keys), int(held)
        if wanted == self._wanted:
            return
        self.give_up()
        self._wanted, self._age, self._tried = wanted, age, False
        self._releasing = pressed & ~wanted != 0
        self._pressing = wanted & ~pressed != 0

    def frame(self, felt: Keys) -> None:
        """``felt`` are pressed at the end of one more frame."""
        self._frame += 1
        if not (self._releasing or self._pressing):
            return
        self._age, self._tried = self._age + 1, True
        if self._age > MOST_FRAMES:  # it waited too long
            self._age = MOST_FRAMES
            self.give_up()
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
        if self._tried:  # else nothing was seen of it
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


class WatchedHands:
    """Implements `Hands` by others, timed by ``watch``."""

    def __init__(self, hands: Hands, watch: KeyWatch) -> None:
        self._hands = hands
        self._watch = watch

    @property
    def held(self) -> Keys:
        return self._hands.held

    def rest(self) -> None:
        self._hands.rest()
        self._watch.restart()

    def command(self, keys: Keys) -> None:
        self._watch.command(keys, self._hands.held)
        self._hands.command(keys)

    def step_frame(self) -> Keys:
        felt = self._hands.step_frame()
        self._watch.frame(felt)
        return felt
