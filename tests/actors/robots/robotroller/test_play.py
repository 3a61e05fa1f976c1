"""The Robotroller in its environment, in a check, and beside a policy of NAO's."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import viewer.check
from actors.envs import make_env
from actors.envs.robot import RobotEnv
from actors.robots.latency import Change
from actors.robots.robotroller.robot import Robotroller
from common.errors import InputError
from common.registry import ROBOTS
from common.run.rules import check_config
from common.settings.presets import PRESETS
from tests.paths import ROOT
from tests.viewer.commands import command


def test_it_plays_by_its_name() -> None:
    play = replace(PRESETS["robot"].play, robot="robotroller", vector=True, random_starts=0)
    config = replace(PRESETS["robot"], play=play)
    check_config(config)
    env = make_env(config, training=False)
    assert isinstance(env, RobotEnv)
    assert isinstance(env.robot, Robotroller)
    observation, _ = env.reset(seed=1)
    assert isinstance(observation, dict)
    joints = len(env.robot.proprioception()[0])
    assert joints == ROBOTS.find("robotroller").joints == 3
    assert len(observation["vector"]) == config.vector_width == 128 + 2 * 3
    rng = np.random.default_rng(1)
    matched = []
    for action in rng.integers(config.action_count, size=60):
        observation, *_, info = env.step(action)
        assert info["valid_frame"]
        assert env.observation_space.contains(observation)
        matched.append(info["keys_match"])
    assert np.mean(matched) > 0.95
    truth = env.robot.true_corners()
    assert env.detection.corners is not None
    assert np.abs(env.detection.corners.mean(axis=0) - truth.mean(axis=0)).max() < 1.0
    env.close()


def test_its_check_is_green(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    every_change: list[Change],
) -> None:
    monkeypatch.setattr(viewer.check, "AGENT_STEPS", 20)
    monkeypatch.setattr(viewer.check, "changes", lambda *_: every_change)
    path = tmp_path / "check.png"
    assert command(monkeypatch, "check", "--robot", "robotroller", "-o", str(path)) == 0
    said = capsys.readouterr().out
    assert said.count("│ green │") == 4
    assert "command → keys, 612 changes" in said
    picture = cv2.imread(str(path))
    assert picture is not None
    assert picture.shape == (768, 1024, 3)


def test_a_policy_that_feels_naos_joints_cannot_play_on_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    weights = ROOT / "policies" / "robot_pong.safetensors"
    words = r"with 144 numbers of proprioception, .* 134 numbers .*: give --robot nao\.$"
    with pytest.raises(InputError, match=words):
        command(monkeypatch, "play", str(weights), "--robot", "robotroller")
