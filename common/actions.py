"""The 18 actions of the Atari console and the five controller keys that make them up.

The order is that of `ale_py.Action`, so an action's number is the emulator's number.
"""

from enum import IntFlag


class Keys(IntFlag):
    """Keys held down on the controller, as a bit mask."""

    NONE = 0
    UP = 1
    DOWN = 2
    LEFT = 4
    RIGHT = 8
    FIRE = 16


_U, _D, _L, _R, _F = Keys.UP, Keys.DOWN, Keys.LEFT, Keys.RIGHT, Keys.FIRE

KEYS_OF_ACTION: tuple[Keys, ...] = (
    Keys.NONE,
    _F,
    _U,
    _R,
    _L,
    _D,
    _U | _R,
    _U | _L,
    _D | _R,
    _D | _L,
    _U | _F,
    _R | _F,
    _L | _F,
    _D | _F,
    _U | _R | _F,
    _U | _L | _F,
    _D | _R | _F,
    _D | _L | _F,
)
"""Keys of each of ALE's 18 actions, indexed by the action's number."""

OPPOSITES = (_U | _D, _L | _R)
"""Pairs of keys that a controller never closes together."""


def _without_opposites(bits: int) -> Keys:
    closed = Keys(bits)
    for pair in OPPOSITES:
        if closed & pair == pair:
            closed &= ~pair
    return closed


_ACTION_OF_KEYS = tuple(KEYS_OF_ACTION.index(_without_opposites(bits)) for bits in range(32))


def action_of_keys(pressed: int) -> int:
    """Returns ALE's action number for the `Keys` ``pressed``; opposite keys cancel, as on a real
    joystick."""
    return _ACTION_OF_KEYS[pressed]
