"""Layout of the vector observation: proprioception beside the frames.

Oldest first within each group, with the settings' ``play.vector_commands`` C and
``play.vector_key_frames`` F (6 and 4 by default), and J joints::

    [0, 18 C)              the last C commands, one-hot over ALE's 18 actions; all zero before the
                           first
    [18 C, 18 C + 5 F)     the keys (up, down, left, right, fire) at the end of each of the last F
                           emulator frames, 1 where pressed
    [18 C + 5 F, ... + J)  angles of the robot's J joints, -1 at the lower limit and 1 at the upper;
                           NAO's 8 are the left, then the right arm's ShoulderPitch, ShoulderRoll,
                           ElbowYaw and ElbowRoll
    [... + J, ... + 2J)    speeds of the same joints as shares of their maximum

The last two groups are a robot's alone, and ``play.vector_joints`` has to ask for them.
All numbers are within [-1, 1].
"""

from typing import TYPE_CHECKING

from common.actions import KEYS_OF_ACTION, Keys

if TYPE_CHECKING:
    from common.run.conditions import PlayConfig

ACTIONS = len(KEYS_OF_ACTION)
COMMANDS = 6
"""Commands that are remembered, unless the settings say otherwise."""
KEYS = tuple(key for key in Keys if key)
KEY_FRAMES = 4
"""Emulator frames whose keys are remembered, unless the settings say otherwise."""


def vector_width(play: "PlayConfig", joints: int) -> int:
    """Returns how many numbers the vector observation of a robot with that many joints has; 0
    joints without a robot."""
    told = 2 * joints if play.vector_joints else 0
    return play.vector_commands * ACTIONS + play.vector_key_frames * len(KEYS) + told
