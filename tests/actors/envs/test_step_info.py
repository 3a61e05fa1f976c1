"""What an environment says about a step: one declaration, typed from any dictionary."""

import gymnasium
import numpy as np
import pytest

from actors.envs.ale import AtariEnv
from actors.envs.robot import RobotEnv
from actors.envs.step_info import StepInfo
from common.errors import InputError


def test_there_and_back() -> None:
    info = StepInfo(True, 2.5, 7, keys_match=False, elapsed=3, key_times=(1, 4))
    assert StepInfo.of(info._asdict()) == info


def test_what_an_environment_does_not_say_is_as_for_one_without_a_robot() -> None:
    found = StepInfo.of({"game_over": False, "game_score": 0.0, "game_steps": 1})
    assert found == StepInfo(False, 0.0, 1, True, True, True, 1, False, 0, 0, ())


def test_numbers_of_numpy_and_keys_of_wrappers_do_no_harm() -> None:
    told = {
        "game_over": np.bool_(True),
        "game_score": np.float32(1.5),
        "game_steps": np.int64(9),
        "late_frames": np.uint8(3),
        "key_times": np.array([5, 6]),
        "episode": {"r": 1.0},
    }
    found = StepInfo.of(told)
    assert found == StepInfo(True, 1.5, 9, late_frames=3, key_times=(5, 6))
    assert [type(value) for value in found[:5]] == [bool, float, int, bool, bool]


def test_an_environment_that_does_not_say_where_games_end_is_told_so() -> None:
    with pytest.raises(InputError, match="info lacks game_over, game_steps"):
        StepInfo.of({"game_score": 1.0})


@pytest.mark.parametrize("kind", [AtariEnv, RobotEnv])
def test_wrong_calls_are_refused_in_a_sentence(kind: type[AtariEnv | RobotEnv]) -> None:
    env = kind("pong")
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        env.step(0)
    env.reset(seed=1)
    for action in (99, 18, -1):
        with pytest.raises(gymnasium.error.InvalidAction, match=f"no action {action}: choose.*17"):
            env.step(action)
    _, _, _, _, info = env.step(17)
    assert StepInfo.of(info)._asdict() == info
    env.close()
