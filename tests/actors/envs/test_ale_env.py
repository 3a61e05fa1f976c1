"""ALE-Only against a plain loop over ALE, and Gymnasium's rules."""

from typing import Any

import cv2
import gymnasium
import numpy as np
import pytest
from ale_py import ALEInterface
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray

from actors.envs import make_env
from actors.envs.ale import AtariEnv
from actors.envs.step_info import StepInfo
from ale_robot.environments import env_id
from common.actions import Keys
from common.errors import InputError
from common.settings.conditions import PlayConfig
from common.settings.config import RunConfig
from tests.actors.envs.narrowed import frames_of, rom_of


def test_an_episode_is_what_bare_ale_shows() -> None:
    ale = ALEInterface()
    ale.setInt("frame_skip", 1)
    ale.setFloat("repeat_action_probability", 0.0)
    ale.setBool("color_averaging", True)
    ale.loadROM(rom_of("breakout"))

    def look() -> NDArray[Any]:
        return cv2.resize(ale.getScreenGrayscale(), (84, 84), interpolation=cv2.INTER_AREA)

    env = AtariEnv("breakout", play=PlayConfig(random_starts=0), training=True)
    state, info = env.reset(seed=1)
    seen = [look()] * 4
    score, steps, lives, episodes, points = 0.0, 0, 5, 0, 0.0
    rng = np.random.default_rng(2)
    for _ in range(400):
        assert np.array_equal(frames_of(state), seen[-4:])
        assert (info["game_score"], info["game_steps"]) == (score, steps)
        assert set(info) == set(StepInfo._fields)
        assert info["valid_frame"]
        assert info["keys_match"]
        action = int(rng.integers(18))
        reward = sum(ale.act(action) for _ in range(4))
        seen.append(look())
        score, steps, points = score + reward, steps + 1, points + reward
        state, got, terminated, truncated, info = env.step(action)
        assert got == reward
        assert not truncated
        assert info["elapsed"] == 1
        assert info["game_over"] == ale.game_over()
        assert terminated == (ale.lives() < lives)
        lives = ale.lives()
        if terminated:
            episodes += 1
            if ale.game_over():
                assert info["game_score"] == score
                ale.reset_game()
                score, steps, lives = 0.0, 0, 5
            state, info = env.reset()
            assert not info["game_over"]
            assert info["elapsed"] == 0
            seen = [look()] * 4
    assert episodes > 5
    assert points > 0


def test_states_given_out_do_not_change_later() -> None:
    env = AtariEnv("pong")
    states = [frames_of(env.reset(seed=1)[0])]
    copies = [states[0].copy()]
    for step in range(20):
        states.append(frames_of(env.step(step % 18)[0]))
        copies.append(states[-1].copy())
    assert all(np.array_equal(*pair) for pair in zip(states, copies, strict=True))
    assert not np.array_equal(states[1], states[-1])


def _trace(env: AtariEnv, seed: int) -> list[bytes]:
    state, info = env.reset(seed=seed)
    trace = [frames_of(state).tobytes() + repr(sorted(info.items())).encode()]
    for step in range(250):
        state, reward, terminated, truncated, info = env.step((7 * step) % 18)
        trace.append(frames_of(state).tobytes() + repr((reward, sorted(info.items()))).encode())
        if terminated or truncated:
            env.reset()
    return trace


def test_a_seed_makes_everything_repeat() -> None:
    env = AtariEnv("breakout", training=True)
    first = _trace(env, 5)
    assert _trace(env, 5) == first
    assert _trace(AtariEnv("breakout", training=True), 5) == first
    assert _trace(env, 6) != first


def test_actions_are_the_games_own_or_all() -> None:
    own = AtariEnv("breakout", play=PlayConfig(minimal_actions=True, random_starts=0))
    every = AtariEnv("breakout", play=PlayConfig(random_starts=0))
    assert own.action_space == gymnasium.spaces.Discrete(4)
    assert every.action_space == gymnasium.spaces.Discrete(18)
    own.reset(seed=0)
    every.reset(seed=0)
    for step in range(100):
        index = step // 5 % 4
        (shown, *_), (same, *_) = own.step(index), every.step((0, 1, 3, 4)[index])
        assert np.array_equal(frames_of(shown), frames_of(same))


@pytest.mark.parametrize("asked", [{"options": {"new_game": True}}, {"seed": 2}])
def test_options_or_a_seed_force_a_new_game(asked: dict[str, Any]) -> None:
    env = AtariEnv("breakout", training=True)
    env.reset(seed=1)
    while not env.step(1)[2]:
        pass
    _, info = env.reset()
    assert info["game_steps"] > 30
    while not env.step(1)[2]:
        pass
    _, info = env.reset(**asked)
    assert info["game_steps"] <= 30


@pytest.mark.filterwarnings("error::UserWarning")
def test_gymnasium_finds_nothing_to_complain_about() -> None:
    for game, settings in (
        ("pong", {}),
        ("space_invaders", {"training": True, "play": PlayConfig(minimal_actions=True)}),
        ("journey_escape", {"play": PlayConfig(frame_stack=1, frame_skip=1)}),
    ):
        name = env_id(game, robot=False)
        env = gymnasium.make(name, render_mode="rgb_array", **settings)
        check_env(env.unwrapped)
        env.reset(seed=0)
        for _ in range(3):
            env.step(env.action_space.sample())
        rows = 230 if game == "journey_escape" else 210
        picture = env.render()
        assert isinstance(picture, np.ndarray)
        assert picture.shape == (rows, 160, 3)


def test_make_env_follows_the_configuration() -> None:
    play = PlayConfig(minimal_actions=True, frame_stack=2, random_starts=0)
    config = RunConfig(env="ale", game="breakout", play=play)
    for training in (True, False):
        env = make_env(config, training=training)
        assert isinstance(env, AtariEnv)
        assert env.action_space == gymnasium.spaces.Discrete(4)
        assert env.observation_space.shape == (2, 84, 84)
        env.reset(seed=0)
        while not env.step(1)[2]:
            pass
        assert (env.reset()[1]["game_steps"] > 0) == training  # carried on, or anew
    with pytest.raises(InputError, match="did you mean"):
        make_env(RunConfig(env="ale", game="breakuot"), training=True)


def test_no_key_of_the_game_before_is_pressed_in_a_new_one() -> None:
    env = AtariEnv(play=PlayConfig(random_starts=0, read_keys="decision"))  # that of a robot only
    env.reset(seed=1)
    env.step(2)
    assert (env.wanted, env.pressed) == (Keys.UP, Keys.UP)
    env.reset(options={"new_game": True})
    assert (env.wanted, env.pressed) == (Keys.NONE, Keys.NONE)
