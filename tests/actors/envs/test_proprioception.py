"""The vector observation, against a naive reading of its documented layout."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.envs import make_env
from actors.envs.ale import AtariEnv
from actors.envs.key_forecast import KeyForecast
from actors.envs.observation import observation_space
from actors.envs.proprioception import Proprioception
from actors.envs.robot import RobotEnv
from common.actions import KEYS_OF_ACTION, Keys
from common.settings.conditions import MAX_PICTURE_LATENCY, PlayConfig
from common.settings.config import RunConfig
from tests.actors.envs.narrowed import nao_of

PLAY = PlayConfig(vector=True, random_starts=0)


def expected(
    commands: list[int], keys: list[Keys], remembered: int = 6, frames: int = 4
) -> list[float]:
    """Commands and key flags, one number after the other."""
    numbers: list[float] = []
    for action in ([None] * remembered + commands)[-remembered:]:
        numbers += [float(action == each) for each in range(18)]
    for held in ([Keys.NONE] * frames + keys)[-frames:]:
        numbers += [
            float(key in held) for key in (Keys.UP, Keys.DOWN, Keys.LEFT, Keys.RIGHT, Keys.FIRE)
        ]
    return numbers


@given(
    st.lists(st.integers(0, 17), max_size=12),
    st.lists(st.integers(0, 31).map(Keys), max_size=9),
    st.sampled_from([(6, 4), (1, 1), (9, 2), (2, 7)]),
)
def test_commands_and_keys(commands: list[int], keys: list[Keys], length: tuple[int, int]) -> None:
    sense = Proprioception(PlayConfig(vector_commands=length[0], vector_key_frames=length[1]))
    for action in commands:
        sense.command(action)
    for held in keys:
        sense.feel(held)
    assert sense.vector().tolist() == expected(commands, keys, *length)
    sense.forget()
    assert not sense.vector().any()


def test_what_was_given_out_does_not_change() -> None:
    sense = Proprioception(PLAY)
    before = sense.vector()
    sense.command(3)
    sense.feel(Keys.FIRE)
    assert not before.any()


@pytest.mark.parametrize("late", [0, 1, 2, 5, 4 * MAX_PICTURE_LATENCY])
def test_late_pictures_have_the_keys_of_their_moment_and_those_that_came_since(late: int) -> None:
    play = PlayConfig(vector_commands=1, vector_key_frames=2, vector_forecast=3)
    sense, forecast, felt = Proprioception(play), KeyForecast(3), list[Keys]()
    for frame in range(4 * MAX_PICTURE_LATENCY + 9):
        action = frame * 7 % 18
        sense.command(action)
        forecast.command(KEYS_OF_ACTION[action])
        felt.append(KEYS_OF_ACTION[(frame - 3) * 7 % 18])  # three frames later
        sense.feel(felt[-1])
        forecast.feel(felt[-1])
    sense.seen_late = late
    vector, seen = sense.vector(), len(felt) - late
    assert vector[18:28].tolist() == expected([], felt[:seen], 0, 2)
    since = [[1.0, 1.0, *expected([], [keys], 0, 1)] for keys in felt[seen:]]
    coming = forecast.rows().tolist()
    assert vector[28:].reshape(3, 7).tolist() == (since + coming)[:3]
    assert coming[0] != coming[1] != coming[2]


def test_joints_come_last_and_stay_within_bounds() -> None:
    sense = Proprioception(PLAY, joints=8)
    angles, speeds = np.linspace(-1.1, 1.0, 8), np.linspace(0.0, 1.4, 8)
    vector = sense.vector(angles, speeds)
    assert vector.dtype == np.float32
    assert vector[128:136] == pytest.approx(angles.clip(-1, 1))
    assert vector[136:] == pytest.approx(speeds.clip(-1, 1))


@pytest.mark.parametrize("env", ["ale", "robot"])
def test_the_configuration_knows_the_width(env: Any) -> None:
    assert RunConfig(env=env).vector_width == 0
    config = RunConfig(env=env, play=PLAY)
    assert config.vector_width == {"ale": 128, "robot": 144}[env]


@pytest.mark.parametrize("env", ["ale", "robot"])
def test_the_configuration_knows_the_width_of_longer_histories(env: Any) -> None:
    play = replace(PLAY, vector_commands=10, vector_key_frames=40)
    config = RunConfig(env=env, play=play)
    # 10 commands of 18 actions, 40 frames of 5 keys, 8 joints.
    assert config.vector_width == 180 + 200 + {"ale": 0, "robot": 16}[env]
    made = make_env(config, training=False)
    observation, _ = made.reset(seed=1)
    assert made.observation_space.contains(observation)
    assert observation["vector"].shape == (config.vector_width,)
    made.close()


@pytest.mark.parametrize(("remembered", "frames"), [(6, 4), (3, 9)])
def test_the_emulators_vector(remembered: int, frames: int) -> None:
    env = AtariEnv(play=replace(PLAY, vector_commands=remembered, vector_key_frames=frames))
    observation, _ = env.reset(seed=1)
    assert isinstance(observation, dict)
    assert not observation["vector"].any()
    commands, keys = [], []
    for action in (3, 0, 17, 1, 5, 5, 10, 2):
        observation, *_ = env.step(action)
        commands.append(action)
        keys += [KEYS_OF_ACTION[action]] * 4
        assert env.observation_space.contains(observation)
        assert isinstance(observation, dict)
        assert observation["vector"].tolist() == expected(commands, keys, remembered, frames)
    observation, _ = env.reset(options={"new_game": True})
    assert isinstance(observation, dict)
    assert not observation["vector"].any()


def test_the_robots_vector() -> None:
    env = RobotEnv(play=PLAY)
    observation, _ = env.reset(seed=1)
    assert env.observation_space.contains(observation)
    commands = []
    for action in (3, 0, 17, 17, 17):
        observation, *_ = env.step(action)
        commands.append(action)
        assert env.observation_space.contains(observation)
    assert isinstance(observation, dict)
    vector = observation["vector"]
    assert vector[:108].tolist() == expected(commands, [])[:108]
    assert vector[108:128].tolist() == expected([], [KEYS_OF_ACTION[17]] * 4)[108:]
    at = 128
    nao = nao_of(env)
    engine = nao._engine
    names = {
        engine.getJointInfo(nao.body, joint)[1].decode(): joint
        for joint in range(engine.getNumJoints(nao.body))
    }
    for side in "LR":
        for name in ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll"):
            info = engine.getJointInfo(nao.body, names[side + name])
            angle, speed, *_ = engine.getJointState(nao.body, names[side + name])
            share = (angle - info[8]) / (info[9] - info[8])
            assert vector[at] == pytest.approx(2 * share - 1, abs=1e-6)
            assert vector[at + 8] == pytest.approx(speed / info[11], abs=1e-6)
            at += 1
    env.close()


def test_joints_can_be_left_out() -> None:
    play = PlayConfig(vector=True, vector_joints=False)
    sense = Proprioception(play, joints=8)
    sense.command(3)
    told = sense.vector(np.ones(8), np.ones(8))
    assert told.tolist() == expected([3], [], 6, 4)
    assert told.shape == (128,)
    assert observation_space(play, 8) == observation_space(play)
    assert RunConfig(env="robot", play=play).vector_width == 128
