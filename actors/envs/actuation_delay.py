"""A hand as a model: keys that follow commands with a given latency, without any physics.

Between the emulator, whose keys are as commanded at once, and the robot, whose arms take their
time, it tells how much delay alone costs a learner. A pure delay would not do as a model of an
arm: on the way from one key to another, an arm holds neither.
"""

from common.actions import Keys
from common.run.conditions import PlayConfig


class ActuationDelay:
    """Implements `Hands`: keys that follow each command with the latencies of ``play``.

    The keys of the previous command are released when a command arrives, and its own are pressed
    ``press_latency`` emulator frames later.
    """

    def __init__(self, play: PlayConfig) -> None:
        self._play = play
        self.rest()

    @property
    def held(self) -> Keys:
        return self._held

    def rest(self) -> None:
        self._held = self._old = self._wanted = Keys.NONE
        self._since = 0
        """Emulator frames since the last command that asked for other keys."""

    def command(self, keys: Keys) -> None:
        if keys != self._wanted:
            self._old, self._wanted, self._since = self._held, keys, 0

    def step_frame(self) -> Keys:
        self._held = self._wanted
        if self._since < self._play.press_latency:
            # What both commands hold stays down, as under a finger that has not to move.
            self._held &= self._old
        self._since += 1
        return self._held
