"""Layout of the vector observation: proprioception beside the frames.

Oldest first within each group::

    [0, 108)    the last 6 commands, one-hot over ALE's 18 actions; all zero before the first
    [108, 128)  the keys (up, down, left, right, fire) at the end of each of the last 4 emulator
                frames, 1 where pressed
    [128, 128 + J)       robot only: angles of its J joints, -1 at the lower limit and 1 at the
                         upper; NAO's 8 are the left, then the right arm's ShoulderPitch,
                         ShoulderRoll, ElbowYaw and ElbowRoll
    [128 + J, 128 + 2J)  robot only: speeds of the same joints as shares of their maximum

All numbers are within [-1, 1].
"""

from common.actions import KEYS_OF_ACTION, Keys

ACTIONS = len(KEYS_OF_ACTION)
COMMANDS = 6
KEYS = tuple(key for key in Keys if key)
KEY_FRAMES = 4

COMMANDS_PART = slice(0, COMMANDS * ACTIONS)
KEYS_PART = slice(COMMANDS_PART.stop, COMMANDS_PART.stop + KEY_FRAMES * len(KEYS))


def vector_width(joints: int) -> int:
    """Returns how many numbers the vector observation of a robot with that many joints has; 0
    joints without a robot."""
    return KEYS_PART.stop + 2 * joints
