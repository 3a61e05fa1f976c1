"""ALE-Robot as a Gymnasium environment: it sees, it touches, it obeys, it repeats itself."""

import ctypes
import warnings
from collections.abc import Callable, Iterator

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.seeding import np_random
from numpy.typing import NDArray

from actors.envs import sight_check
from actors.envs.emulator import Emulator
from actors.envs.observation import shrink
from actors.envs.robot import RobotEnv
from ale_robot.environments import env_id
from common.actions import KEYS_OF_ACTION, Keys
from common.errors import InputError
from common.settings.conditions import CameraConfig, PlayConfig
from tests.actors.envs.narrowed import frames_of, nao_of
from tests.actors.envs.sticky_reference import StickyActions

Picture = NDArray[np.uint8]
Draw = Callable[[Picture], Picture]


@pytest.fixture(scope="module")
def env() -> Iterator[RobotEnv]:
    env = RobotEnv()
    yield env
    env.close()


def play(env: RobotEnv, seed: int, steps: int) -> list[object]:
    state, info = env.reset(seed=seed)
    seen: list[object] = [frames_of(state).tobytes(), info]
    rng = np.random.default_rng(seed)
    for action in rng.integers(18, size=steps):
        state, reward, terminated, truncated, info = env.step(int(action))
        seen += [frames_of(state).tobytes(), reward, terminated, truncated, info]
    return seen


def test_gymnasium_finds_nothing_wrong() -> None:
    env = gymnasium.make(env_id("pong", robot=True), render_mode="rgb_array")
    assert isinstance(env.unwrapped, RobotEnv)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)
    env.close()


def test_the_same_seed_gives_the_same_game(env: RobotEnv) -> None:
    first = play(env, 7, 40)
    other = play(env, 8, 40)
    assert play(env, 7, 40) == first != other
    fresh = RobotEnv()
    assert play(fresh, 7, 40) == first
    fresh.close()


def test_the_console_repeats_actions_whatever_the_hands_press(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    env = RobotEnv(play=PlayConfig(random_starts=0, eye="emulator", sticky=0.5))
    env.reset(seed=4)
    pressed: list[int] = []
    hold = env._game.hold

    def note(action: int) -> float:
        pressed.append(action)
        return hold(action)

    monkeypatch.setattr(env._game, "hold", note)
    rng = np.random.default_rng(1)
    for action in rng.integers(18, size=40):
        *_, info = env.step(int(action))
        assert info["keys_match"] == (env.pressed == KEYS_OF_ACTION[action])  # the hands' alone
    console, ale = Emulator("pong", 0), StickyActions(0.5, int(np_random(4)[0].integers(2**31)))
    for action in pressed:
        console.act(ale.frame(action))
    assert len(set(pressed)) > 5
    assert np.array_equal(env.emulator.ram(), console.ram())
    env.close()


def test_without_an_eye_pictures_are_taken_only_for_who_looks() -> None:
    emulator = PlayConfig(eye="emulator")
    unseen, watched, seeing = (RobotEnv(play=each) for each in (emulator, emulator, PlayConfig()))
    drawn: list[RobotEnv] = []
    for env in (unseen, watched, seeing):
        nao = nao_of(env)

        def draw(game: Picture, env: RobotEnv = env, nao_draws: Draw = nao.picture) -> Picture:
            drawn.append(env)
            return nao_draws(game)

        nao.picture = draw  # type: ignore[method-assign]
    for env in (unseen, watched, seeing):
        env.reset(seed=3)
    for action in np.random.default_rng(3).integers(18, size=12):
        (state, *rest), (other, *same), (_, *third) = (
            env.step(int(action)) for env in (unseen, watched, seeing)
        )
        assert frames_of(state).tobytes() == frames_of(other).tobytes()
        assert rest == same == third
        assert (watched.seen == seeing.seen).all()
        assert (watched.seen == watched.seen).all()
    assert [drawn.count(env) for env in (unseen, watched, seeing)] == [0, 12, 13]
    for env in (unseen, watched, seeing):
        env.close()


def test_the_eye_sees_what_the_emulator_shows(env: RobotEnv) -> None:
    env.reset(seed=1)
    rng = np.random.default_rng(0)
    for _ in range(40):
        state, _, _, _, info = env.step(int(rng.integers(18)))
        assert info["valid_frame"]
        truth = shrink(env.emulator.screen_grey())
        assert np.abs(frames_of(state)[-1].astype(int) - truth).mean() <= 2.0
    assert frames_of(state)[-1].std() > 10


def test_a_camera_that_freezes_is_told(env: RobotEnv, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sight_check, "_PERIOD", 2)
    env.reset(seed=1)
    alive = [env.step(step % 6)[4] for step in range(30)]
    kept = env.seen.copy()
    with monkeypatch.context() as frozen:
        frozen.setattr(env.robot, "camera_picture", lambda *_: kept)
        infos = [env.step(step % 6)[4] for step in range(30)]
    again = [env.step(step % 6)[4] for step in range(30)]
    assert np.mean([info["frame_follows"] for info in alive]) > 0.9
    assert all(info["valid_frame"] for info in infos)  # the screen is where it was
    assert np.mean([info["frame_follows"] for info in infos]) < 0.1
    assert np.mean([info["frame_follows"] for info in again]) > 0.9


def test_a_camera_that_loses_pictures_on_purpose_is_not_judged() -> None:
    env = RobotEnv("pong", camera=CameraConfig(dropped=0.8))
    env.reset(seed=1)
    assert all(env.step(step % 6)[4]["frame_follows"] for step in range(40))
    env.close()


def test_a_picture_that_does_not_change_is_no_fault_while_the_game_stands_still(
    env: RobotEnv, monkeypatch: pytest.MonkeyPatch
) -> None:
    env.reset(seed=1)
    screen = env.emulator.screen_rgb()
    monkeypatch.setattr(env.emulator, "screen_rgb", lambda: screen)
    env.step(0)
    assert all(env.step(0)[4]["frame_follows"] for _ in range(5))


@pytest.mark.parametrize("camera", [CameraConfig(), CameraConfig(glare=0.3, noise=8.0)])
def test_a_black_game_within_its_border_is_not_seen(
    camera: CameraConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    env = RobotEnv("pong", camera=camera)
    env.reset(seed=1)
    rows, columns = env.emulator.screen_shape
    black = np.zeros((rows, columns, 3), np.uint8)

    def valid() -> bool:
        """After as many steps as the check needs."""
        return bool([env.step(0)[4]["valid_frame"] for _ in range(sight_check._PERIOD)][-1])

    assert valid()
    with monkeypatch.context() as dark:
        take = env.robot.camera_picture
        dark.setattr(env.robot, "camera_picture", lambda screen, passed: take(black, passed))
        assert not valid()
        dark.setattr(env.emulator, "screen_rgb", lambda: black)
        assert valid()  # the game itself shows nothing
    assert valid()
    env.close()


@pytest.mark.parametrize(("most", "over"), [(300, False), (2_000, True)])
def test_lives_and_games_that_a_random_start_loses_end_no_episode(most: int, over: bool) -> None:
    """Even if the game ended, and it is played from its very beginning instead."""
    play = PlayConfig(
        random_starts=most,
        hand="model",
        eye="emulator",
        minimal_actions=True,
        vector=True,
        vector_joints=False,
    )
    env = RobotEnv("breakout", play=play, training=True)
    met = False
    for seed in range(6):
        observation, info = env.reset(seed=seed)
        anew = info["game_steps"] == 0
        met |= anew if over else env.emulator.lives < 5
        if anew:
            assert (env.pressed, env.wanted) == (Keys.NONE, Keys.NONE)
            assert isinstance(observation, dict)
            assert not observation["vector"].any()
        assert env.step(0)[2:4] == (False, False)
    assert met
    env.close()


def test_pressed_keys_play_the_game(env: RobotEnv) -> None:
    """Pong's right paddle goes up for as long as the hand holds the stick to the right."""
    env.reset(seed=2, options={"new_game": True})
    paddle = 51  # where Pong keeps the right paddle's place in its memory
    heights = []
    for action in (3, 4):
        for _ in range(12):
            *_, info = env.step(action)
        assert info["keys_match"]
        heights.append(int(env.emulator.ram()[paddle]))
    assert abs(heights[0] - heights[1]) > 50


@pytest.mark.parametrize("action", range(18))
def test_all_actions_are_pressed(env: RobotEnv, action: int) -> None:
    env.reset(seed=3)
    matches = [env.step(action)[4]["keys_match"] for _ in range(3)]
    assert matches[1:] == [True, True]
    assert nao_of(env).controller.held == KEYS_OF_ACTION[action]


def test_keys_match_tells_of_a_hand_that_does_not_obey(
    env: RobotEnv, monkeypatch: pytest.MonkeyPatch
) -> None:
    env.reset(seed=3)
    for _ in range(3):
        env.step(0)
    with monkeypatch.context() as broken:
        broken.setattr(nao_of(env).arms.right, "advance", lambda: None)
        for _ in range(3):
            *_, info = env.step(1)
        assert not info["keys_match"]
    for _ in range(3):
        *_, info = env.step(1)
    assert info["keys_match"]


def test_a_random_start_goes_through_the_hands() -> None:
    """Without one the hands are at rest at the start; with one they seldom are."""
    still = RobotEnv(play=PlayConfig(random_starts=0))
    _, info = still.reset(seed=0)
    assert info["game_steps"] == 0
    assert nao_of(still).controller.held == Keys.NONE
    still.close()
    moved = RobotEnv(play=PlayConfig(random_starts=5))
    steps, held = [], []
    for seed in range(6):
        _, info = moved.reset(seed=seed)
        steps.append(info["game_steps"])
        held.append(nao_of(moved).controller.held)
    assert len(set(steps)) > 1
    assert max(steps) <= 5
    assert set(held) != {Keys.NONE}
    moved.close()


def test_a_game_can_be_cut(env: RobotEnv) -> None:
    short = RobotEnv(play=PlayConfig(random_starts=0, max_game_frames=20))
    short.reset(seed=0)
    ends = [short.step(0)[2:4] for _ in range(5)]
    assert ends == [(False, False)] * 4 + [(False, True)]
    short.close()


def test_a_lost_life_ends_a_training_episode_and_the_game_goes_on() -> None:
    env = RobotEnv("breakout", play=PlayConfig(random_starts=0), training=True)
    env.reset(seed=0)
    terminated = False
    for _ in range(400):
        *_, terminated, _, info = env.step(1)
        if terminated:
            break
    assert terminated
    assert not info["game_over"]
    steps = info["game_steps"]
    _, info = env.reset()
    assert info["game_steps"] == steps
    assert info["elapsed"] == 0
    env.close()


def test_minimal_actions() -> None:
    env = RobotEnv(play=PlayConfig(minimal_actions=True, random_starts=0))
    assert env.action_space == gymnasium.spaces.Discrete(6)
    env.reset(seed=0)
    for _ in range(2):
        env.step(1)
    assert nao_of(env).controller.held == Keys.FIRE
    env.close()


def test_an_unknown_game_is_refused() -> None:
    with pytest.raises(InputError, match="pongg"):
        RobotEnv("pongg")


def test_nothing_is_printed(capfd: pytest.CaptureFixture[str]) -> None:
    env = RobotEnv(render_mode="rgb_array")
    env.reset(seed=0)
    env.step(6)
    env.render()
    env.close()
    ctypes.CDLL(None).fflush(None)
    assert capfd.readouterr() == ("", "")
