"""The 18 actions, against ALE's own names for them."""

import ale_py
import pytest

from common.actions import KEYS_OF_ACTION, Keys, action_of_keys

ALL_KEYS = [Keys(mask) for mask in range(32)]


def keys_in(name: str) -> Keys:
    """NOOP → none, UPRIGHTFIRE → up, right and fire."""
    found = Keys.NONE
    for key in Keys:
        if key.name is not None and key.name in name:
            found |= key
            name = name.replace(key.name, "")
    assert name in ("", "NOOP"), name
    return found


@pytest.mark.parametrize("name", list(ale_py.Action.__members__))
def test_an_actions_keys_are_those_in_its_name(name: str) -> None:
    number = ale_py.Action.__members__[name].value
    assert KEYS_OF_ACTION[number] == keys_in(name)


def test_there_are_18_actions_all_different() -> None:
    assert len(KEYS_OF_ACTION) == len(ale_py.Action.__members__) == 18
    assert len(set(KEYS_OF_ACTION)) == 18


@pytest.mark.parametrize("action", range(18))
def test_the_keys_of_an_action_make_that_action(action: int) -> None:
    assert action_of_keys(KEYS_OF_ACTION[action]) == action


@pytest.mark.parametrize("pressed", ALL_KEYS)
def test_opposite_keys_cancel_and_the_others_count(pressed: Keys) -> None:
    vertical = (Keys.UP in pressed) - (Keys.DOWN in pressed)
    horizontal = (Keys.RIGHT in pressed) - (Keys.LEFT in pressed)
    name = ("", "UP", "DOWN")[vertical] + ("", "RIGHT", "LEFT")[horizontal]
    name += "FIRE" if Keys.FIRE in pressed else ""
    assert action_of_keys(pressed) == ale_py.Action.__members__[name or "NOOP"].value
