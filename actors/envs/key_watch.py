"""Times the hands while they play: from each command to its keys, frame by frame.

`common.press_latency` says what is measured and how it is used. A command may wait before it
reaches the hands. Its time counts from when it was given, and later commands that are still on
their way do not end it.
"""

import math
from collections import deque

from actors.robots.interface import Hands
from common.actions import Keys
from common.press_latency import MAX_FRAMES, Goal, place_of

_KEPT = 1_024
"""Maximum number of outcomes kept until `KeyWatch.take`. A step has at most two for each command.
The emulator alone takes none."""


class KeyWatch:
    """Times one pair of hands.

    It runs in every frame and therefore uses whole numbers instead of `Keys`.
    """

    def __init__(self) -> None:
        self._found: deque[int] = deque(maxlen=_KEPT)
        self.restart()

    def restart(self) -> None:
        """Forgets everything: the hands are at rest without a command."""
        self._found.clear()
        self._frame = 0
        self._given: deque[int] = deque()
        """Frames in which those commands were given that have not reached the hands."""
        self._wanted = 0
        self._given_at = -1
        """Frame in which the present command was given."""
        self._age = 0
        self._tried = False
        """Whether a frame has passed since the hands got the command."""
        self._releasing = self._pressing = False
        self._since = -math.inf
        """Frame from which on commands are watched."""

    def disregard(self) -> None:
        """Forgets what was measured, and leaves out all commands of former frames, even if they
        have not reached the hands yet."""
        self._found.clear()
        self._releasing = self._pressing = False
        self._since = self._frame

    def give(self, ago: int = 0) -> None:
        """Notes that a command was given ``ago`` emulator frames ago.

        Commands reach the hands in the order in which they are given.
        """
        self._given.append(self._frame - ago)

    def command(self, keys: Keys, held: Keys) -> None:
        """Notes that the oldest command on its way reaches the hands.

        They are to hold ``keys`` and now hold ``held``. The same keys once more are not a new
        command: the first one is still watched. Nor are other keys that were given in the same
        frame: hands that wait for each key take a command step by step.
        """
        given = self._given.popleft()
        wanted, pressed = int(keys), int(held)
        if wanted == self._wanted:
            return
        if given != self._given_at:
            self.give_up()
            self._tried = False
        self._wanted, self._given_at, self._age = wanted, given, self._frame - given
        watched = given >= self._since
        self._releasing = watched and pressed & ~wanted != 0
        self._pressing = watched and wanted & ~pressed != 0

    def frame(self, felt: Keys) -> None:
        """Notes that the keys ``felt`` are pressed at the end of one more frame."""
        self._frame += 1
        if not (self._releasing or self._pressing):
            return
        self._age, self._tried = self._age + 1, True
        if self._age > MAX_FRAMES:  # it waited too long
            self._age = MAX_FRAMES
            self.give_up()
        pressed = int(felt)
        if self._releasing and not pressed & ~self._wanted:
            self._releasing = False
            self._note("release", True)
        if self._pressing and not self._wanted & ~pressed:
            self._pressing = False
            self._note("press", True)
        if self._age == MAX_FRAMES:
            self.give_up()

    def give_up(self) -> None:
        """Stops watching the present command: its time is over, or another command came."""
        if self._tried:  # otherwise its effect could not be seen
            if self._releasing:
                self._note("release", False)
            if self._pressing:
                self._note("press", False)
        self._releasing = self._pressing = False

    def take(self) -> tuple[int, ...]:
        """Returns what was measured since the last call: `place_of` each outcome, oldest first."""
        found = tuple(self._found)
        self._found.clear()
        return found

    def _note(self, goal: Goal, reached: bool) -> None:
        self._found.append(place_of(goal, reached, self._age))


class WatchedHands:
    """Implements `Hands` with other ``hands``, which ``watch`` times."""

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
