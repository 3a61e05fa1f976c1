"""A model of a hand: keys that follow commands with a given latency, without any physics.

It isolates what latency alone costs a learner. It stands between the emulator, whose keys follow a
command at once, and the robot, whose arms take time. Keys that are all late by as much would be a
poor model of an arm: on its way from one key to another, an arm holds neither.
"""

from common.actions import Keys
from common.settings.conditions import PlayConfig


class ModelledHand:
    """Implements `Hands`: keys that follow each command with the latency that ``play`` sets.

    When a command arrives, the keys of the previous one are released. Its own keys are pressed
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
            # Keys of both commands stay down: the finger on them need not move.
            self._held &= self._old
        self._since += 1
        return self._held
