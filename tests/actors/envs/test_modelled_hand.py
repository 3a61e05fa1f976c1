"""The modelled hand by hand-written sequences, and what it does to the emulator and the robot."""

from dataclasses import replace

import numpy as np
import pytest

from actors.envs.ale import AtariEnv
from actors.envs.emulator import Emulator
from actors.envs.hands import hands_of
from actors.envs.modelled_hand import ModelledHand
from actors.envs.observation import shrink
from actors.envs.robot import RobotEnv
from actors.robots.interface import Hands
from common.actions import KEYS_OF_ACTION, Keys
from common.settings.clock import ClockConfig
from common.settings.conditions import PlayConfig
from tests.actors.envs.narrowed import nao_of

NONE, UP, DOWN, FIRE = Keys.NONE, Keys.UP, Keys.DOWN, Keys.FIRE


def modelled(play: PlayConfig) -> Hands:
    return hands_of(play, None, np.random.default_rng(0))


def frames(keys: Hands, *commands: Keys, count: int = 4) -> list[list[Keys]]:
    """What is pressed in each frame of each agent step."""
    pressed = []
    for command in commands:
        keys.command(command)
        pressed.append([keys.step_frame() for _ in range(count)])
    return pressed


def test_without_delays_keys_are_the_commands() -> None:
    assert frames(ModelledHand(PlayConfig()), UP, NONE, DOWN) == [
        [UP] * 4,
        [NONE] * 4,
        [DOWN] * 4,
    ]


def test_the_old_key_goes_first_and_the_new_one_comes_later() -> None:
    keys = ModelledHand(PlayConfig(press_latency=3))
    assert frames(keys, UP, DOWN, DOWN, NONE) == [
        [NONE, NONE, NONE, UP],
        [NONE, NONE, NONE, DOWN],
        [DOWN] * 4,
        [NONE] * 4,
    ]


def test_what_both_commands_hold_stays_down() -> None:
    keys = ModelledHand(PlayConfig(press_latency=3))
    assert frames(keys, UP | FIRE, DOWN | FIRE) == [
        [NONE, NONE, NONE, UP | FIRE],
        [FIRE, FIRE, FIRE, DOWN | FIRE],
    ]


def test_a_command_on_the_way_is_overtaken() -> None:
    keys = ModelledHand(PlayConfig(press_latency=6))
    # UP would be down from the seventh frame on; what is new starts from where the hand is.
    for new in (DOWN, UP | FIRE):
        keys.rest()
        assert frames(keys, UP, new, new) == [[NONE] * 4, [NONE] * 4, [NONE, NONE, new, new]]


def test_lateness_is_of_game_time_however_many_commands_are_given() -> None:
    keys = modelled(PlayConfig(actuation_latency=4))
    keys.command(UP)
    assert [keys.step_frame() for _ in range(9)] == [NONE] * 4 + [UP] * 5
    keys.command(DOWN)  # in the middle of an agent step, as in real time
    assert [keys.step_frame() for _ in range(2)] == [UP] * 2
    keys.command(FIRE)
    assert [keys.step_frame() for _ in range(6)] == [UP] * 2 + [DOWN] * 2 + [FIRE] * 2


def test_a_robot_that_waits_for_its_keys_gets_them() -> None:
    play = PlayConfig(random_starts=0, hand="model", actuation_latency=4, eye="emulator")
    env = RobotEnv("pong", play=play, clock=ClockConfig(wait_action=True))
    env.reset(seed=1)
    for action in (2, 5, 0):
        *_, info = env.step(action)
        assert (info["elapsed"], info["gave_up"], info["keys_match"]) == (2, False, True)
    env.close()


def test_the_emulator_is_played_by_the_modelled_hand() -> None:
    play = PlayConfig(random_starts=0, minimal_actions=True, press_latency=3, actuation_latency=4)
    env = AtariEnv("pong", play=play)
    env.reset(seed=3)
    emulator, keys = Emulator("pong", 0), modelled(play)
    rng = np.random.default_rng(0)
    matched = []
    for action in np.repeat(rng.integers(6, size=20), 3):
        wanted = KEYS_OF_ACTION[env._game.actions[action]]
        keys.command(wanted)
        points = 0.0
        for _ in range(4):
            pressed = keys.step_frame()
            points += emulator.act(KEYS_OF_ACTION.index(pressed))
        state, reward, *_, info = env.step(action)
        assert isinstance(state, np.ndarray)
        assert (state[-1] == shrink(emulator.screen_grey())).all()
        assert reward == points
        assert info["keys_match"] == (pressed == wanted)
        matched.append(info["keys_match"])
    assert 0.5 < np.mean(matched) < 0.9  # one agent step late, of three


@pytest.mark.parametrize(("eye", "sticky"), [("camera", 0.0), ("emulator", 0.0), ("emulator", 0.5)])
def test_a_robot_with_a_modelled_hand_plays_as_the_emulator_does(eye: str, sticky: float) -> None:
    play = PlayConfig(random_starts=0, press_latency=3, hand="model", vector=True)
    play = replace(play, eye=eye, sticky=sticky)  # type: ignore[arg-type]
    robot, alone = RobotEnv("pong", play=play), AtariEnv("pong", play=play)
    robot.reset(seed=1)
    alone.reset(seed=1)
    rng = np.random.default_rng(1)
    for action in np.repeat(rng.integers(18, size=12), 3):
        seen, reward, *_, info = robot.step(action)
        known, points, *_, other = alone.step(action)
        assert (reward, info["keys_match"]) == (points, other["keys_match"])
        assert (robot.emulator.ram() == alone.emulator.ram()).all()
        assert isinstance(seen, dict)
        assert isinstance(known, dict)
        difference = np.abs(seen["frames"].astype(int) - known["frames"])
        assert (difference.max() == 0) == (eye == "emulator")
        assert difference.mean() < 8
        # The robot's vector has its arms too; they rest.
        assert (seen["vector"][:128] == known["vector"]).all()
    assert nao_of(robot).arms.posture()[1] == pytest.approx(0, abs=0.01)
    robot.close()


def test_hands_play_while_the_eye_is_the_emulators() -> None:
    env = RobotEnv("pong", play=PlayConfig(random_starts=0, eye="emulator"))
    env.reset(seed=1)
    for action in (2, 2, 5, 5, 0):
        state, *_, info = env.step(action)
        assert isinstance(state, np.ndarray)
        assert (state[-1] == shrink(env.emulator.screen_grey())).all()
        assert info["valid_frame"]
    assert np.abs(nao_of(env).arms.posture()[0]).max() > 0
    env.close()
