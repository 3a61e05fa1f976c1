"""Layout of the vector observation: proprioception beside the frames.

Oldest first within each group::

    [0, 108)    the last 6 commands, one-hot over ALE's 18 actions; all zero before the first
    [108, 128)  the keys (up, down, left, right, fire) at the end of each of the last 4 emulator
                frames, 1 where pressed
    [128, 136)  robot only: angles of the left, then the right arm's ShoulderPitch, ShoulderRoll,
                ElbowYaw and ElbowRoll, -1 at the lower limit and 1 at the upper
    [136, 144)  robot only: speeds of the same joints as shares of their maximum

All numbers are within [-1, 1].
"""

from typing import Literal

from common.actions import KEYS_OF_ACTION, Keys

ACTIONS = len(KEYS_OF_ACTION)
COMMANDS = 6
KEYS = tuple(key for key in Keys if key)
KEY_FRAMES = 4
JOINTS = 8

COMMANDS_PART = slice(0, COMMANDS * ACTIONS)
KEYS_PART = slice(COMMANDS_PART.stop, COMMANDS_PART.stop + KEY_FRAMES * len(KEYS))
ANGLES_PART = slice(KEYS_PART.stop, KEYS_PART.stop + JOINTS)
SPEEDS_PART = slice(ANGLES_PART.stop, ANGLES_PART.stop + JOINTS)


def width_of(env: Literal["ale", "robot"]) -> int:
    """Returns the width of an environment's vector observation."""
    return SPEEDS_PART.stop if env == "robot" else KEYS_PART.stop
