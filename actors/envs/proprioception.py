"""The vector observation: what the agent told its hands, and what it feels of them.

A picture alone tells neither which command is still on its way nor where the hands are; with both
the state is complete although the arms are slow. `common.proprioception` says what stands where.
"""

import numpy as np
from numpy.typing import NDArray

from common.actions import Keys
from common.proprioception import ACTIONS, KEYS, vector_width
from common.run.conditions import PlayConfig

_FLAGS = np.array(
    [[bool(number & key) for key in KEYS] for number in range(2 ** len(KEYS))], np.float32
)
"""Which keys are in each set of keys, ``[32, 5]``."""


class Proprioception:
    """Remembers commands and keys. Vectors it gave out never change afterwards."""

    def __init__(self, play: PlayConfig, joints: int = 0) -> None:
        """``play`` says how much is remembered; ``joints`` is the number J of the robot's joints, 0
        without a robot."""
        self.key_frames = play.vector_key_frames
        """Emulator frames whose keys are remembered."""
        self._now = np.zeros(vector_width(play, joints), np.float32)
        commands = play.vector_commands * ACTIONS
        self._felt = commands + play.vector_key_frames * len(KEYS)
        self._commands, self._keys = self._now[:commands], self._now[commands : self._felt]

    def forget(self) -> None:
        """As before the first command, with no key pressed."""
        self._now[:] = 0.0

    def command(self, action: int) -> None:
        """Remember a command, one of ALE's 18 actions."""
        self._commands[:-ACTIONS] = self._commands[ACTIONS:].copy()
        self._commands[-ACTIONS:] = 0.0
        self._commands[action - ACTIONS] = 1.0

    def feel(self, pressed: Keys) -> None:
        """Remember the keys pressed at the end of one emulator frame."""
        self._keys[: -len(KEYS)] = self._keys[len(KEYS) :].copy()
        self._keys[-len(KEYS) :] = _FLAGS[pressed]

    def vector(self, *joints: NDArray[np.float64]) -> NDArray[np.float32]:
        """Returns the observation, ``float32 [P]``.

        Args:
            joints: `Robot.proprioception`, angles and speeds ``[J]`` each; nothing without a
                robot. Left out if the settings leave them out.
        """
        vector = self._now.copy()
        if joints and self._felt < len(vector):
            # The engine keeps a joint's greatest speed only nearly, and not against a push.
            vector[self._felt :] = np.concatenate(joints).clip(-1.0, 1.0)
        return vector
