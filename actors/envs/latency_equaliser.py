"""One latency for all hands: quick ones get their commands later.

A policy plays well at the latency that it learned with, and a few emulator frames more or less cost
it the game. What cannot be made quicker can be waited for: each command is held back until the
hands, whose keys are timed, take exactly as long as the slowest ones that are expected. A receiver
of speech does the same with packets that come after different times (a playout buffer).
"""

from actors.envs.key_timing import KeyTiming
from actors.envs.late_commands import WaitingCommands
from actors.robots.interface import Hands
from common.actions import Keys


class LatencyEqualiser(WaitingCommands):
    """Implements `Hands` by others, which begin to follow a command ``latency`` emulator frames
    after what was seen when it was given; later where they need longer by themselves.

    How long they take from their first change of keys to the last one remains their own. Until they
    changed a key nothing is known of them, and commands go on at once.
    """

    def __init__(self, hands: Hands, latency: int) -> None:
        super().__init__(hands)
        self.seen_late = 0
        """Emulator frames by which the eye's pictures are late."""
        self._latency = latency
        self._timing = KeyTiming()

    def rest(self) -> None:
        super().rest()
        self._timing.restart()

    def step_frame(self) -> Keys:
        felt = super().step_frame()
        self._timing.feel(felt)
        return felt

    @property
    def _spare(self) -> int:
        # Less than 0 where the hands are slow: what waits is due at once.
        own = (self._timing.release.frames, self._timing.press.frames)
        known = [frames for frames in own if frames is not None]
        return self._latency - self.seen_late - min(known) if known else 0

    def _pass_on(self, keys: Keys) -> None:
        super()._pass_on(keys)
        self._timing.command(keys)
