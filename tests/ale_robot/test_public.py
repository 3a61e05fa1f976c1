"""What a program that imports `ale_robot` finds."""

import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

import ale_robot
from actors.envs.robot import RobotEnv
from common.errors import InputError
from common.games import GAMES
from common.settings.clock import ClockConfig
from common.settings.conditions import CameraConfig, PlayConfig
from common.settings.ranges import RandomiseConfig
from tests.paths import ROOT


def test_all_games_are_registered_under_both_names() -> None:
    assert ale_robot.env_id("space_invaders", robot=True) == "ALERobot/SpaceInvaders-v0"
    assert ale_robot.env_id("tic_tac_toe_3d", robot=False) == "ALERobot/TicTacToe3D-Emulator-v0"
    for game in GAMES:
        for robot in (True, False):
            spec = gymnasium.spec(ale_robot.env_id(game, robot=robot))
            assert spec.kwargs == {"game": game}
            assert spec.entry_point == (
                f"ale_robot.entry_points:{'robot' if robot else 'emulator'}_env"
            )


@pytest.mark.parametrize("package", ["ale_robot", "actors.envs"])
def test_importing_the_package_loads_no_physics_and_no_vision(package: str) -> None:
    code = (
        f"import sys, {package}\n"
        "loaded = {'pybullet', 'cv2', 'torch'} & set(sys.modules)\n"
        "assert not loaded, loaded\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_public_names_are_told() -> None:
    assert ale_robot.__version__
    assert dir(ale_robot) == sorted(ale_robot.__all__)  # those too that are loaded when asked for
    assert all(getattr(ale_robot, name) for name in ale_robot.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = ale_robot.nothing


def test_a_shipped_policy_plays_in_its_own_environment() -> None:
    policy = ale_robot.load_policy("ale_pong")
    assert repr(policy) == "TrainedPolicy('ale_pong'), trained to play pong (ale)"
    env = policy.make_env()
    observation, _ = env.reset(seed=1)
    values = policy.q_values(observation)
    assert values.shape == (6,)
    assert policy.act(observation) == int(np.argmax(values))
    assert all(ale_robot.load_policy("ale_pong", epsilon=1.0).act(observation) < 6 for _ in "ab")


@pytest.mark.parametrize(
    "observation",
    [
        np.zeros((4, 84, 84), np.uint8),
        {"frames": np.zeros((4, 84, 84), np.uint8)},
        {},
        {"frames": np.zeros((84, 84, 4), np.uint8), "vector": np.zeros(144, np.float32)},
        {"frames": np.zeros((4, 84, 84), np.float32), "vector": np.zeros(144, np.float32)},
        {"frames": np.zeros((4, 84, 84), np.uint8), "vector": np.zeros(3, np.float32)},
    ],
)
def test_an_observation_of_another_environment_is_refused(observation: Any) -> None:
    policy = ale_robot.load_policy("robot_pong")
    with pytest.raises(InputError, match=r"^the policy takes frames of uint8 \(4, 84, 84\) and a"):
        policy.act(observation)


@pytest.mark.parametrize(
    ("vector", "told"),
    [
        (["?"] * 144, "are no numbers"),
        ([[1.0], [1.0, 2.0]], "are no numbers"),
        (np.full(144, np.nan), "not finite"),
    ],
)
def test_a_vector_without_numbers_is_refused(vector: Any, told: str) -> None:
    frames = np.zeros((4, 84, 84), np.uint8)
    with pytest.raises(InputError, match=told):
        ale_robot.load_policy("robot_pong").act({"frames": frames, "vector": vector})


def test_a_vector_of_any_type_of_numbers_is_the_same() -> None:
    policy, frames = ale_robot.load_policy("robot_pong"), np.zeros((4, 84, 84), np.uint8)
    values = [
        policy.q_values({"frames": frames, "vector": np.ones(144, kind)})
        for kind in (np.float32, ">f4", np.int64)
    ]
    assert all(np.array_equal(each, values[0]) for each in values)


@pytest.mark.parametrize("name", ["robot_pong_pixels", "robot_pong"])
def test_a_policys_network_can_be_exported(name: str) -> None:
    policy = ale_robot.load_policy(name)
    rng = np.random.default_rng(1)
    frames = rng.integers(256, size=(4, 84, 84), dtype=np.uint8)
    vector = rng.random(policy.config.vector_width, np.float32)
    inputs = torch.from_numpy(frames[None]), torch.from_numpy(vector[None])
    exported = torch.export.export(policy.network, inputs).module()
    observation = {"frames": frames, "vector": vector} if len(vector) else frames
    for network in (policy.network, exported):
        values = network(*inputs)[0].detach().numpy()
        np.testing.assert_allclose(values, policy.q_values(observation), atol=1e-5)


def test_a_policy_plays_and_is_evaluated_under_other_conditions() -> None:
    policy = ale_robot.load_policy("ale_pong")
    usual, noisy = policy.make_env(), policy.make_env(camera=CameraConfig(noise=60.0))
    first, other = (env.reset(seed=1)[0] for env in (usual, noisy))
    assert np.abs(first.astype(int) - other).mean() > 10  # grey levels
    shown: Any = noisy.render()
    assert shown.shape == (210, 160, 3)
    sticky = replace(policy.config.play, sticky=0.25)
    found = ale_robot.evaluate("ale_pong", games=1, epsilon=1.0, play=sticky)
    assert found["changed"] == ["play.sticky 0.0 → 0.25"]
    with pytest.raises(InputError, match=r"^camera\.noise is -1"):
        policy.make_env(camera=CameraConfig(noise=-1))
    told = r"trained with 6 actions, .* 18 actions: give play\.minimal_actions=True\.$"
    with pytest.raises(InputError, match=told):
        ale_robot.evaluate("ale_pong", play=PlayConfig())


def test_conditions_that_its_training_drew_are_no_change() -> None:
    policy = ale_robot.load_policy("robot_pong_worlds")
    assert policy.config.randomise == RandomiseConfig()
    short = replace(policy.config.play, max_game_frames=80)
    found = ale_robot.evaluate(policy, games=1, play=short)
    assert found["weights"] == "robot_pong_worlds"
    assert found["changed"] == ["play.max_game_frames 108000 → 80"]


def test_a_policy_plays_in_another_environment() -> None:
    """`ale_pong` knows the game only from the emulator's own picture."""
    policy = ale_robot.load_policy("ale_pong")
    env = policy.make_env(env="robot")
    assert isinstance(env, RobotEnv)
    frames: Any = env.reset(seed=1)[0]
    assert frames.shape == (4, 84, 84)
    env.close()
    short = replace(policy.config.play, max_game_frames=80)
    found = ale_robot.evaluate("ale_pong", games=1, env="robot", play=short)
    assert found["changed"][0] == "env ale → robot"
    with pytest.raises(InputError, match="here it would have 4 actions: give game='pong', or name"):
        policy.make_env(game="breakout")
    with pytest.raises(InputError, match="no environment 'emulator'"):
        ale_robot.evaluate("ale_pong", env="emulator")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"games": 0}, r"^games is 0: choose 1 or more\."),
        ({"epsilon": 1.5}, r"^epsilon is 1\.5: choose at most 1\."),
        ({"processes": -1}, r"^processes is -1: choose 0 or more\."),
        ({"seed": -1}, r"^seed is -1: choose 0 or more\."),
        ({"seed": 1.5}, r"^seed is 1\.5, which is not a whole number"),
        ({"games": "2"}, r"^games is '2', which is not a whole number"),
        ({"play": 3}, r"^play is 3: give a PlayConfig\."),
        ({"camera": {"noise": 8}}, r"^camera is \{'noise': 8\}: give a CameraConfig\."),
        ({"camera": PlayConfig()}, r"^camera is PlayConfig\(.*: give a CameraConfig\."),
    ],
)
def test_arguments_of_an_evaluation_out_of_bounds_are_told(
    given: dict[str, Any], told: str
) -> None:
    with pytest.raises(ale_robot.InputError, match=told):
        ale_robot.evaluate("ale_pong", **given)


@pytest.mark.parametrize(
    ("name", "settings", "told"),
    [
        (
            "Pong",
            {"play": PlayConfig(actuation_latency=99)},
            r"play\.actuation_latency is 99: choo",
        ),
        ("Pong", {"play": PlayConfig(eye="nose")}, r"play\.eye is 'nose'"),  # type: ignore[arg-type]
        ("Pong", {"camera": {"noise": 5}}, r"^camera is \{'noise': 5\}: give a CameraConfig\."),
        ("Pong", {"clock": ClockConfig(sync=False, speed=0.0)}, r"^--speed is 0\.0: choose"),
        ("Pong", {"clock": None}, r"^clock is None: give a ClockConfig\."),
        ("Pong-Emulator", {"clock": ClockConfig()}, "^clock is for the robot: the emulator alone"),
        ("Pong", {"discount": 7.0}, r"^discount is 7\.0: choose from 0 to 1\."),
        ("Pong", {"discount": "much"}, r"^discount is 'much': choose from 0 to 1\."),
        ("Pong-Emulator", {"play": PlayConfig(frame_stack=0)}, r"play\.frame_stack is 0: choose"),
        (
            "Pong-Emulator",
            {"camera": CameraConfig(distortion=0.06)},
            r"camera\.distortion is 0\.06",
        ),
        (
            "Pong-Emulator",
            {"randomise": RandomiseConfig(distortion=0.1)},
            "randomise.distortion is",
        ),
        (
            "Pong",
            {"play": PlayConfig(press_latency=3)},
            r"press_latency is 3, .* arms: give play\.hand model",
        ),
        ("Pong", {"play": PlayConfig(robot="nobody")}, "there is no robot 'nobody'"),
    ],
)
def test_settings_without_effect_are_told_to_gymnasium_too(
    name: str, settings: dict[str, Any], told: str
) -> None:
    with pytest.raises(InputError, match=told):
        gymnasium.make(f"ale_robot:ALERobot/{name}-v0", **settings)


def test_who_only_plays_may_stack_more_frames_than_a_runs_messages_hold() -> None:
    env = gymnasium.make("ale_robot:ALERobot/Pong-Emulator-v0", play=PlayConfig(frame_stack=16))
    assert env.reset(seed=1)[0].shape == (16, 84, 84)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"epsilon": 3.0}, r"^epsilon is 3\.0: choose at most 1\."),
        ({"epsilon": "a"}, r"^epsilon is 'a', which is not a number"),
        ({"seed": -1}, r"^seed is -1: choose 0 or more\."),
        ({"seed": 1.5}, r"^seed is 1\.5, which is not a whole number"),
        ({"seed": np.float64(1.5)}, r"^seed is 1\.5, which is not a whole number"),
        ({"weights": 3}, r"^weights is 3: give a policy, its file, or its name\."),
        ({"weights": None}, r"^weights is None: give a policy"),
    ],
)
def test_arguments_out_of_bounds_are_told(given: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError, match=told):
        ale_robot.load_policy(**{"weights": "ale_pong", **given})


def test_numbers_of_numpy_and_loaded_policies_are_taken() -> None:
    policy: Any = ale_robot.load_policy("ale_pong", epsilon=np.float32(0.5), seed=np.int64(3))  # type: ignore[arg-type]
    again: Any = ale_robot.load_policy(policy)
    assert (policy._policy.epsilon, again._policy.epsilon) == (0.5, 0.0)


def test_what_is_no_policy_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"published policy: .*ale_pong, "):
        ale_robot.load_policy("nobody")
    alone = tmp_path / "alone.safetensors"
    alone.write_bytes((ROOT / "policies" / "ale_pong.safetensors").read_bytes())
    with pytest.raises(InputError, match=r"settings of the training of .* are unknown"):
        ale_robot.evaluate(alone)
    with pytest.raises(AttributeError, match="nothing"):
        _ = ale_robot.nothing


def test_a_package_that_something_hides_is_told(tmp_path: Path) -> None:
    (tmp_path / "common").mkdir()
    (tmp_path / "common" / "__init__.py").touch()
    program = f"import sys; sys.path[:0] = [{str(tmp_path)!r}, {str(ROOT)!r}]; import ale_robot"
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert ended.stderr.splitlines()[-1] == (
        f"ImportError: {tmp_path}/common hides the package common of ale-robot: run it in another "
        "folder."
    )


def test_a_policy_plays_in_real_time_and_under_drawn_conditions() -> None:
    policy = ale_robot.load_policy("robot_pong_pixels")
    drawn = ale_robot.RandomiseConfig(noise=8.0)
    hasty = ale_robot.ClockConfig(sync=False, speed=4.0)
    with closing(policy.make_env(randomise=drawn, clock=hasty)) as env:
        env.reset(seed=1)
        assert isinstance(env, RobotEnv)
        assert 0 < env.conditions.camera.noise <= 8
        assert env.clock == hasty
    wrong: dict[str, Any]
    for wrong in ({"clock": 1}, {"randomise": 0.5}):
        with pytest.raises(InputError, match="give a "):
            policy.make_env(**wrong)
    with pytest.raises(InputError, match="--no-sync is for a robot"):
        ale_robot.evaluate("ale_pong", clock=hasty)
