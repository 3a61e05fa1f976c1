"""Another robot: a class, and its entry in the registry."""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from numpy.random import Generator
from numpy.typing import NDArray

from actors.envs import make_env
from actors.envs.robot import RobotEnv
from actors.robots.interface import Robot
from common.actions import Keys
from common.errors import InputError
from common.protocol.live_view import ViewName
from common.registry import ROBOTS, RobotKind
from common.settings.clock import ClockConfig
from common.settings.conditions import CameraConfig, Conditions, PlayConfig
from common.settings.config import RunConfig, StreamConfig
from common.settings.presets import PRESETS
from tests.extending.whole_run import added, learned

PREPARATION = 2
"""Frames that a finger of it takes."""


class Finger:
    """A robot with a single joint that presses all commanded keys, two frames later."""

    def __init__(
        self, screen_shape: tuple[int, int], camera: CameraConfig, play: PlayConfig
    ) -> None:
        self.screen_shape = screen_shape
        self.games = self.closed = 0
        self.rest()

    @property
    def held(self) -> Keys:
        return self._held

    def rest(self) -> None:
        self._held = self._wanted = Keys.NONE
        self._left = 0

    def command(self, keys: Keys) -> None:
        if keys != self._wanted:
            self._wanted, self._left = keys, PREPARATION

    def step_frame(self) -> Keys:
        if self._left:
            self._left -= 1
        else:
            self._held = self._wanted
        return self._held

    def begin_game(self, conditions: Conditions, rng: Generator) -> None:
        self.games += 1

    def camera_picture(self, screen: NDArray[np.uint8], agent_steps: int = 1) -> NDArray[np.uint8]:
        assert screen.shape == (*self.screen_shape, 3)
        return np.zeros((240, 320, 3), np.uint8)

    def proprioception(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return np.array([self._left / PREPARATION]), np.zeros(1)

    def true_corners(self) -> None:
        return None

    def view(
        self,
        screen: NDArray[np.uint8],
        width: int,
        height: int,
        viewpoint: ViewName = "room",
        *,
        moved: bool = True,
        turn: float = 0.0,
    ) -> NDArray[np.uint8]:
        return np.full((height, width, 3), 255 * (viewpoint == "hands"), np.uint8)

    def close(self) -> None:
        self.closed += 1


FINGER = RobotKind("finger", Finger, joints=1)


def config() -> RunConfig:
    """Pong by the finger, which feels itself and is shown the emulator's own picture."""
    robot = PRESETS["robot"]
    return replace(
        robot,
        play=replace(robot.play, robot="finger", vector=True, eye="emulator", max_game_frames=240),
        stream=StreamConfig(chunk_steps=16, window=2),
        replay=replace(robot.replay, capacity=5_000, learning_starts=64, ratio_tolerance=64),
        learning=replace(robot.learning, batch_size=4, train_period=8, publish_period=1),
        protocol=replace(robot.protocol, epoch_steps=10_000, held_out_states=16),
    )


def test_it_is_a_robot() -> None:
    robot: Robot = Finger((210, 160), CameraConfig(), PlayConfig())
    assert robot.held == Keys.NONE


def test_its_keys_play_the_game() -> None:
    with added(ROBOTS, FINGER):
        env = make_env(config(), ClockConfig(wait_action=True), training=True)
        assert isinstance(env, RobotEnv)
        assert isinstance(env.robot, Finger)
        observation, _ = env.reset(seed=1)
        assert isinstance(observation, dict)
        assert env.observation_space.contains(observation)
        assert len(observation["vector"]) == config().vector_width == 130
        _, _, _, _, info = env.step(1)
        assert (info["keys_match"], info["elapsed"]) == (True, 1)
        assert env.pressed == Keys.FIRE
        assert env.robot.games == 1
        assert (env.view(64, 48, "hands") == 255).all()
        env.close()
        assert env.robot.closed == 1


def test_a_robot_that_declares_other_joints_than_it_has_is_refused() -> None:
    with added(ROBOTS, replace(FINGER, joints=2)):
        told = "the robot 'finger' has 1 joint, and its `RobotKind` declares 2: mend that"
        with pytest.raises(InputError, match=told):
            make_env(config(), ClockConfig(), training=True)


@pytest.mark.parametrize("hand", ["arm", "model"])
def test_a_robot_from_outside_is_learned_with(
    tmp_path: Path, hand: Literal["arm", "model"]
) -> None:
    settings = config()
    settings = replace(settings, play=replace(settings.play, hand=hand))
    with added(ROBOTS, FINGER):
        summary, policy = learned(settings, tmp_path, steps=240)
    assert summary["agent_steps"] >= 240
    assert summary["updates"] > 0
    assert summary["games"] >= 2
    assert policy.weights_version > 0
    assert summary["config"]["play"]["robot"] == "finger"
    assert summary["press_match_share"] > 0.5
