"""A hand as a model: keys that follow commands with a given latency, without any physics.

Between the emulator, whose keys are as commanded at once, and the robot, whose arms take their
time, it tells how much delay alone costs a learner. A pure delay would not do as a model of an
arm: on the way from one key to another, an arm holds neither.
"""

from collections import deque

from common.actions import Keys
from common.run.config import PlayConfig


class ActuationDelay:
    """Keys that follow each command with the latencies of ``play``.

    The keys of the previous command are released ``release_latency`` emulator frames after a
    command arrives, and its own are pressed after ``press_latency``. A command arrives
    ``command_latency`` agent steps of game time after it was given.
    """

    def __init__(self, play: PlayConfig) -> None:
        self._play = play
        self.rest()

    @property
    def held(self) -> Keys:
        """The keys that were pressed at the end of the last frame."""
        return self._held

    def rest(self) -> None:
        """No key pressed, no command on its way."""
        self._coming: deque[tuple[int, Keys]] = deque()  # with the frames in which they come
        self._held = self._old = self._wanted = Keys.NONE
        self._frame = self._begun = 0

    def command(self, keys: Keys) -> None:
        """Set out for exactly ``keys``."""
        self._coming.append(
            (self._frame + self._play.command_latency * self._play.frame_skip, keys)
        )

    def step_frame(self) -> Keys:
        """Pass one emulator frame; the keys that are pressed in it."""
        while self._coming and self._coming[0][0] <= self._frame:
            _, wanted = self._coming.popleft()
            if wanted != self._wanted:
                self._old, self._wanted, self._begun = self._held, wanted, self._frame
        since = self._frame - self._begun
        self._held = self._wanted
        if since < self._play.press_latency:
            # What both commands hold stays down, as under a finger that has not to move.
            self._held &= self._old
            if since < self._play.release_latency:
                self._held = self._old
        self._frame += 1
        return self._held
