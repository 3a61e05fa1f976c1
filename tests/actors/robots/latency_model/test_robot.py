"""A robot whose hands are a latency model: its sight is NAO's, its keys are the model's."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actors.envs import make_env
from actors.envs.ale import AtariEnv
from actors.envs.robot import RobotEnv
from actors.robots.latency_model.model import LatencyModel
from actors.robots.nao.robot import Nao
from common.actions import KEYS_OF_ACTION
from common.errors import InputError
from common.run.rules import check_config
from common.settings.conditions import PERFECT_CAMERA, CameraConfig, PlayConfig
from common.settings.presets import PRESETS
from tests.actors.robots.latency_model.models import delay, drawn, plain, saved, together


def test_it_sees_what_nao_sees_and_its_arms_rest(tmp_path: Path) -> None:
    play = PlayConfig(robot=saved(tmp_path / "m.npz", delay(2)), random_starts=0, vector=True)
    env, nao = (RobotEnv("pong", play=each) for each in (play, replace(play, robot="nao")))
    first, of_nao = (each.reset(seed=1)[0] for each in (env, nao))
    assert isinstance(first, dict)
    assert isinstance(of_nao, dict)
    assert all((first[part] == of_nao[part]).all() for part in ("frames", "vector"))
    assert len(first["vector"]) == 128 + 16
    matched = []
    for action in (2, 2, 5, 5, 1, 1):
        state, *_, info = env.step(action)
        matched.append(info["keys_match"])
        assert info["valid_frame"]
        assert isinstance(state, dict)
        assert (state["vector"][-16:] == first["vector"][-16:]).all()
    # Two thirtieths of a second late: nothing of an agent step is left for a new command.
    assert matched == [False, True] * 3
    env.close()
    nao.close()


@pytest.mark.parametrize("vector", [False, True])
def test_robot_and_emulator_alone_are_pressed_by_the_same_keys(
    tmp_path: Path, vector: bool
) -> None:
    arrays = drawn(9, 2)
    play = PlayConfig(
        robot=saved(tmp_path / "m.npz", arrays), random_starts=0, eye="emulator", vector=vector
    )
    robot, alone = RobotEnv("pong", play=play), AtariEnv("pong", play=play)
    commands = np.random.default_rng(3).integers(18, size=40).tolist()
    expected = plain(arrays, [command for command in commands for _ in range(2)])[1::2]
    for _ in range(2):
        robot.reset(seed=1)
        alone.reset(seed=1)
        for command, action in zip(commands, expected, strict=True):
            seen, reward, *_, info = robot.step(command)
            known, points, *_, other = alone.step(command)
            assert robot.pressed == KEYS_OF_ACTION[action]
            assert (reward, info["keys_match"]) == (points, other["keys_match"])
            if vector:
                assert isinstance(seen, dict)
                assert isinstance(known, dict)
                assert (seen["vector"][:128] == known["vector"]).all()
                seen, known = seen["frames"], known["frames"]
            assert isinstance(seen, np.ndarray)
            assert isinstance(known, np.ndarray)
            assert (seen == known).all()
    robot.close()


def test_it_is_made_by_its_files_name(tmp_path: Path) -> None:
    robot = replace(PRESETS["robot"].play, robot=saved(tmp_path / "m.npz", delay(0)))
    config = replace(PRESETS["robot"], play=robot).pinned()
    check_config(config)
    assert config.play.robot.startswith(f"{tmp_path / 'm.npz'}#sha256=")
    env = make_env(config, training=False)
    assert isinstance(env, RobotEnv)
    assert isinstance(env.robot, Nao)
    env.close()
    saved(tmp_path / "m.npz", delay(1))
    with pytest.raises(InputError, match="is not the run's"):
        make_env(config, training=False)


@pytest.mark.parametrize("env", ["robot", "ale"])
def test_a_file_that_is_no_model_makes_no_environment(tmp_path: Path, env: str) -> None:
    (tmp_path / "m.npz").write_bytes(b"PK")
    play = replace(PRESETS["robot"].play, robot=str(tmp_path / "m.npz"))
    config = replace(PRESETS["robot"], env=env, play=play, camera=CameraConfig())
    with pytest.raises(InputError, match="holds no latency model"):
        make_env(config, training=False)


def test_added_latency_comes_on_top_and_each_game_begins_at_rest(tmp_path: Path) -> None:
    play = PlayConfig(
        robot=saved(tmp_path / "m.npz", delay(2)), random_starts=0, actuation_latency=4
    )
    env = AtariEnv("pong", play=play)
    for _ in range(2):
        env.reset(seed=1)
        # A command of every agent step arrives with the next, and its keys with the one after.
        matched = [env.step(action)[-1]["keys_match"] for action in (2, 2, 2, 0, 0, 5)]
        assert matched == [False, False, True, False, False, False]


def pressed_late(env: RobotEnv | AtariEnv, seed: int) -> int:
    """After how many agent steps of a game a command presses."""
    env.reset(seed=seed)
    return next(
        late
        for late, command in enumerate([0] * 9 + [2] * 9, -9)
        if env.step(command)[-1]["keys_match"] and late >= 0
    )


@pytest.mark.parametrize("seen", ["emulator", "camera"])
def test_robot_and_emulator_alone_draw_the_same_copy_for_a_game(tmp_path: Path, seen: Any) -> None:
    robot = saved(tmp_path / "m.npz", together(delay(0), delay(13)))
    play = PlayConfig(robot=robot, eye=seen)
    noisy = CameraConfig(noise=4.0) if seen == "camera" else PERFECT_CAMERA
    envs = RobotEnv("pong", play=play, camera=noisy), AtariEnv("pong", play=play)
    found = [tuple(pressed_late(env, seed) for env in envs) for seed in range(8)]
    assert set(found) == {(0, 0), (6, 6)}
    # Games of one environment differ, too.
    games = [pressed_late(envs[1], seed) for seed in (1, 1)]
    assert games[0] == games[1]
    envs[1].reset(seed=2)
    copies = [envs[1].conditions.copy]
    for _ in range(8):
        envs[1].reset(options={"new_game": True})
        copies.append(envs[1].conditions.copy)
    assert {copy % 2 for copy in copies} == {0, 1}
    envs[0].close()


def test_copies_change_no_other_draw(tmp_path: Path) -> None:
    """Games begin as without a model, with the same random starts and sticky actions."""
    one = saved(tmp_path / "1.npz", delay(3))
    two = saved(tmp_path / "2.npz", together(*[delay(3)] * 2))
    begun = []
    for robot in ("nao", one, two):
        env = AtariEnv("pong", play=PlayConfig(robot=robot, sticky=0.25))
        memories = []
        for seed in (1, None, None):
            env.reset(seed=seed, options={"new_game": True})
            memories.append(env.ram().tolist())
        begun.append(memories)
    assert begun[0] == begun[1] == begun[2]


@pytest.mark.parametrize("seen", ["emulator", "camera"])
@pytest.mark.parametrize("env", ["robot", "ale"])
def test_the_copy_that_plays_is_the_one_that_is_timed(tmp_path: Path, env: str, seen: Any) -> None:
    """Hands of two latencies are made equally late, whichever plays."""
    play = PlayConfig(
        robot=saved(tmp_path / "m.npz", together(delay(2), delay(8))), robot_settings="rate=60",
        random_starts=0, eye=seen, equal_latency=12,
    )  # fmt: skip
    game = RobotEnv("pong", play=play) if env == "robot" else AtariEnv("pong", play=play)
    copies, pressed = set(), set()
    for seed in range(6):
        game.reset(seed=seed)
        copies.add(game.conditions.copy % 2)
        pressed.add(tuple(game.step(2)[-1]["keys_match"] for _ in range(5)))
    assert copies == {0, 1}
    assert pressed == {(False, False, False, True, True)}
    game.close()


def test_a_lost_life_changes_no_hands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    games: list[int] = []
    monkeypatch.setattr(LatencyModel, "take_copy", lambda self, number: games.append(number))
    robot = saved(tmp_path / "m.npz", together(delay(0), delay(2)))
    env = AtariEnv("breakout", play=PlayConfig(robot=robot, minimal_actions=True), training=True)
    for _ in range(6):  # the fifth life is the last
        env.reset()
        terminated = False
        while not terminated:
            _, _, terminated, _, _ = env.step(1)
    assert len(games) == 2
    assert games[0] != games[1]
