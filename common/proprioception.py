"""Layout of the vector observation: proprioception beside the frames.

With the settings' ``play.vector_commands`` C, ``play.vector_key_frames`` F and
``play.vector_forecast`` N (6, 4 and 0 by default), and J joints::

    [0, 18 C)      the last C commands, oldest first, one-hot over ALE's 18 actions; all zero before
                   the first
    [..., + 5 F)   the keys (up, down, left, right, fire) at the end of each of the last F emulator
                   frames, oldest first, 1 where pressed
    [..., + J)     angles of the robot's J joints, -1 at the lower limit and 1 at the upper; NAO's 8
                   are the left, then the right arm's ShoulderPitch, ShoulderRoll, ElbowYaw and
                   ElbowRoll
    [..., + J)     speeds of the same joints as shares of their maximum
    [..., + 7 N)   forecast of each of the next N emulator frames, nearest first: 1 where the next
                   command comes too late to release a key, 1 where it comes too late to press one,
                   and the keys, 1 where pressed, if the last command were kept

Only a robot has joints, and they are included only with ``play.vector_joints``. All numbers are
within [-1, 1].
"""

from typing import NamedTuple

from common.actions import KEYS_OF_ACTION, Keys
from common.settings.conditions import PlayConfig

MAX_VECTOR = 1_024
"""Maximum number of components."""
ACTIONS = len(KEYS_OF_ACTION)
KEYS = tuple(key for key in Keys if key)


class VectorWidths(NamedTuple):
    """Number of components of each group of the vector observation, in order."""

    commands: int
    keys: int
    joints: int
    forecast: int


def vector_widths(play: PlayConfig, joints: int) -> VectorWidths:
    """Returns the widths of the groups of the vector observation, for a robot with that many
    ``joints``; 0 without a robot."""
    return VectorWidths(
        commands=play.vector_commands * ACTIONS,
        keys=play.vector_key_frames * len(KEYS),
        joints=2 * joints if play.vector_joints else 0,
        forecast=play.vector_forecast * (2 + len(KEYS)),
    )


def vector_width(play: PlayConfig, joints: int) -> int:
    """Returns the number of components of the vector observation."""
    return sum(vector_widths(play, joints))
