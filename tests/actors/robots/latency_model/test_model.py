"""Hands that follow a latency model: by hand, and against the function written plainly."""

from pathlib import Path

import numpy as np
import pytest

from actors.robots.latency import FRAME_MS, Latency, changes
from actors.robots.latency_model.model import LatencyModel
from actors.robots.latency_model.weights import ModelWeights
from common.actions import KEYS_OF_ACTION, Keys
from common.settings.conditions import PlayConfig
from tests.actors.robots.latency_model.models import Arrays, delay, drawn, flicker, plain, saved

NONE, UP, FIRE = Keys.NONE, Keys.UP, Keys.FIRE


def hands(arrays: Arrays, rate: int = 30) -> LatencyModel:
    return LatencyModel([ModelWeights(**arrays)], rate)  # type: ignore[arg-type]


def pressed(model: LatencyModel, *commands: Keys, frames: int = 2) -> list[Keys]:
    """What is pressed in each frame."""
    found = []
    for command in commands:
        model.command(command)
        found += [model.step_frame() for _ in range(frames)]
    return found


def test_a_model_of_no_delay_presses_at_once_for_two_frames() -> None:
    model = hands(delay(0))
    assert pressed(model, UP, FIRE, NONE) == [UP, UP, FIRE, FIRE, NONE, NONE]
    # A command between two of the model's turns waits for the next one, as at 30 Hz.
    assert pressed(model, UP, FIRE, NONE, frames=1) == [UP, UP, NONE]
    assert pressed(model, FIRE, frames=1) == [NONE]


def test_at_60_commands_per_second_it_takes_one_in_each_frame() -> None:
    assert pressed(hands(delay(0), 60), UP, FIRE, frames=1) == [UP, FIRE]
    assert pressed(hands(delay(3), 60), UP, *[NONE] * 4, frames=1) == [NONE] * 3 + [UP, NONE]


def test_a_model_of_three_commands_delay() -> None:
    model = hands(delay(3))
    assert pressed(model, UP, UP, FIRE, NONE, NONE, NONE) == ([NONE] * 6 + [UP] * 4 + [FIRE] * 2)
    assert model.held == FIRE


def test_the_oldest_command_is_remembered_and_the_one_before_is_not() -> None:
    model = hands(delay(29))
    found = pressed(model, UP, *[NONE] * 30)
    assert found == [NONE] * 58 + [UP] * 2 + [NONE] * 2


def test_the_action_just_given_counts_and_hidden_units_are_not_negative() -> None:
    # Fire's value is 0.5 + 1 for the command - 1 for having fired just now, less 1: 0.5, else
    # -0.5, where doing nothing is worth 0.25. UP's would be 9 - 1, were it not for the ReLU.
    model = hands(flicker())
    found = pressed(model, FIRE, FIRE, FIRE, UP, FIRE, NONE, NONE, frames=2)[::2]
    assert found == [FIRE, NONE, FIRE, NONE, FIRE, NONE, NONE]


@pytest.mark.parametrize("seed", range(4))
def test_it_is_the_function_written_plainly(seed: int) -> None:
    arrays = drawn(7, seed)
    commands = np.random.default_rng(seed).integers(18, size=120).tolist()
    found = pressed(hands(arrays), *(KEYS_OF_ACTION[command] for command in commands))[::2]
    expected = plain(arrays, commands)
    assert found == [KEYS_OF_ACTION[action] for action in expected]
    assert len(set(expected)) > 4


def test_rest_forgets_all() -> None:
    model = hands(drawn(7, 1))
    commands = [KEYS_OF_ACTION[a] for a in np.random.default_rng(0).integers(18, size=50)]
    first = pressed(model, *commands)
    model.step_frame()  # out of step with the model's turns
    model.rest()
    assert model.held == NONE
    assert pressed(model, *commands) == first


def test_equal_values_give_the_first_action() -> None:
    arrays = {name: np.zeros_like(array) for name, array in delay(0).items()}
    assert pressed(hands(arrays), UP) == [NONE, NONE]


def test_its_latency_is_measured_as_of_any_hands(tmp_path: Path) -> None:
    for rate, frames in ((30, 11), (60, 6)):
        robot = saved(tmp_path / "m.npz", delay(5))
        model = LatencyModel.of_play(PlayConfig(robot=robot, robot_settings=f"rate={rate}"))
        found = list(changes(model, 1, 0))
        latency = Latency.of(found)
        assert latency.p50_ms == latency.p99_ms == pytest.approx(frames * FRAME_MS)
        assert latency.unreached == 0
        # In play, commands from before the old one are still on their way.
        assert {each.strayed for each in found if each.settled} == {False}


def test_of_several_copies_the_chosen_one_holds_the_keys() -> None:
    copies = [drawn(7, seed) for seed in range(3)]
    model = LatencyModel([ModelWeights(**each) for each in copies], 60)  # type: ignore[arg-type]
    commands = np.random.default_rng(9).integers(18, size=60).tolist()
    told = [KEYS_OF_ACTION[command] for command in commands]
    expected = [[KEYS_OF_ACTION[each] for each in plain(copy, commands)] for copy in copies]
    assert pressed(model, *told, frames=1) == expected[0]
    for number in (2, 1, 0, 3, 2_000_000_000):
        model.take_copy(number)
        for _ in range(2):  # a game may put its hands at rest again
            model.rest()
            assert pressed(model, *told, frames=1) == expected[number % 3]
    assert len({tuple(each) for each in expected}) == 3
