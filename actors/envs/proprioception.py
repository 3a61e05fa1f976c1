"""The vector observation: what the agent told its hands, and what it feels of them.

A picture alone shows neither which commands are still on their way nor where the hands are. With
both the state is complete although the arms are slow. `common.proprioception` defines the layout.
"""

import numpy as np
from numpy.typing import NDArray

from actors.envs.key_forecast import FLAGS, KeyForecast
from common.actions import KEYS_OF_ACTION, Keys
from common.proprioception import ACTIONS, KEYS, vector_widths
from common.settings.conditions import MAX_PICTURE_LATENCY, PlayConfig


class Proprioception:
    """Remembers commands and keys. A vector that it returned never changes afterwards."""

    def __init__(self, play: PlayConfig, joints: int = 0) -> None:
        """``play`` says how much is remembered; ``joints`` is the number J of the robot's joints, 0
        without a robot."""
        self._play = play
        self.seen_late = 0
        """Emulator frames by which the eye's pictures are late; the vector's keys are as late."""
        widths = vector_widths(play, joints)
        self._now = np.zeros(sum(widths), np.float32)
        self._commands, self._keys, self._joints, self._coming = np.split(
            self._now, np.cumsum(widths)[:-1]
        )
        remembered = play.vector_key_frames + MAX_PICTURE_LATENCY * play.frame_skip
        self._felt = np.zeros((remembered, len(KEYS)), np.float32)
        """The keys pressed at the end of each of the last frames, newest last."""
        self._forecast = KeyForecast(play.vector_forecast) if play.vector_forecast else None

    def forget(self) -> None:
        """Returns to the state before the first command, with no key pressed."""
        self._now[:] = 0.0
        self._felt[:] = 0.0
        if self._forecast is not None:
            self._forecast.restart()

    def command(self, action: int) -> None:
        """Remembers a command, one of ALE's 18 actions."""
        self._commands[:-ACTIONS] = self._commands[ACTIONS:].copy()
        self._commands[-ACTIONS:] = 0.0
        self._commands[action - ACTIONS] = 1.0
        if self._forecast is not None:
            self._forecast.command(KEYS_OF_ACTION[action])

    def feel(self, pressed: Keys) -> None:
        """Remembers the keys pressed at the end of one emulator frame."""
        self._felt[:-1] = self._felt[1:]
        self._felt[-1] = FLAGS[pressed]
        if self._forecast is not None:
            self._forecast.feel(pressed)

    def vector(self, *joints: NDArray[np.float64]) -> NDArray[np.float32]:
        """Returns the observation, ``float32 [P]``.

        Args:
            joints: angles and speeds ``[J]`` of `Robot.proprioception`; nothing without a robot.
                They are ignored if the settings leave them out.
        """
        if joints and self._joints.size:
            # The engine enforces a joint's maximum speed only nearly, and not against a push.
            np.concatenate(joints).clip(-1.0, 1.0, out=self._joints, casting="same_kind")
        seen = len(self._felt) - self.seen_late
        self._keys[:] = self._felt[seen - self._play.vector_key_frames : seen].ravel()
        if self._forecast is not None:
            rows = self._coming.reshape(self._play.vector_forecast, -1)
            late = min(self.seen_late, len(rows))
            # Frames since the picture have passed: they are known, and too late to change.
            rows[:late, :2], rows[:late, 2:] = 1.0, self._felt[seen : seen + late]
            rows[late:] = self._forecast.rows()[: len(rows) - late]
        return self._now.copy()
