"""Another environment: a class, and its entry in the registry."""

import io
import math
import threading
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import gymnasium
import numpy as np
import pytest
from annotated_types import Ge, Le
from rich.console import Console

from actors.envs import make_env
from actors.envs.checked import CheckedEnv
from actors.envs.step_info import StepInfo
from actors.games import GamesOptions, games
from actors.loop import play
from actors.options import ActorOptions
from actors.policy import Policy
from common.errors import InputError
from common.network import QNetwork, build_network
from common.registry import ENVIRONMENTS, Environment
from common.run.network_file import encode_network_file
from common.run.rules import check_config
from common.settings.clock import ClockConfig
from common.settings.conditions import PlayConfig
from common.settings.config import RunConfig, StreamConfig
from common.settings.own_settings import own_settings
from common.settings.presets import PRESETS
from learner.options import LearnerOptions, run_name
from learner.telemetry.sinks.screen import Screen
from learner.telemetry.snapshot import Snapshot
from learner.telemetry.web.figures import figures
from tests.extending.whole_run import added, learned
from tests.learner.telemetry.snapshots import snapshot
from viewer.recorder import Recorder

GAME_STEPS = 10


@dataclass(frozen=True)
class LampSettings:
    lamps: Annotated[int, Ge(2), Le(7)] = 3
    """Number of lamps."""


class Lamps(gymnasium.Env[Any, np.int64]):
    """Some lamps: to name the one that is lit makes a point; a game has ten of them."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 5}  # noqa: RUF012

    def __init__(self, play: PlayConfig, render_mode: str | None = None) -> None:
        self.render_mode = render_mode
        self._lamps = own_settings(LampSettings, play.env_settings).lamps
        self.action_space = gymnasium.spaces.Discrete(self._lamps)
        shape = (play.frame_stack, 84, 84)
        self.observation_space = gymnasium.spaces.Box(0, 255, shape, np.uint8)
        self._frames = np.zeros(shape, np.uint8)
        self._score, self._steps = 0.0, 0

    @classmethod
    def of_run(cls, config: RunConfig, clock: ClockConfig, *, training: bool) -> "Lamps":
        assert clock == ClockConfig()
        return cls(config.play, render_mode="rgb_array")

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self._score, self._steps = 0.0, 0
        self._frames[:] = self._look()[-1]  # the first state repeats its only frame
        return self._frames.copy(), StepInfo(False, 0.0, 0, elapsed=0)._asdict()

    def step(self, action: np.int64) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        reward = float(action == self._lit)
        self._score += reward
        self._steps += 1
        over = self._steps == GAME_STEPS
        info = StepInfo(over, self._score, self._steps)
        return self._look(), reward, over, False, info._asdict()

    def render(self) -> Any:
        """The lamps from the side, yellow if lit and blue if not, twice as wide as high."""
        picture = np.full((60, 120, 3), (0, 0, 200), np.uint8)
        width = 120 // self._lamps
        picture[:, width * self._lit : width * (self._lit + 1)] = (250, 220, 0)
        return picture

    def _look(self) -> Any:
        self._lit = int(self.np_random.integers(self._lamps))
        self._frames = np.roll(self._frames, -1, axis=0)
        self._frames[-1] = 0
        width = 84 // self._lamps
        self._frames[-1, :, width * self._lit : width * (self._lit + 1)] = 255
        return self._frames.copy()


_FAST = PRESETS["fast"]
CONFIG = replace(
    _FAST,
    env="lamps",
    stream=StreamConfig(chunk_steps=16, window=2),
    replay=replace(_FAST.replay, capacity=5_000, learning_starts=64, ratio_tolerance=64),
    learning=replace(_FAST.learning, batch_size=4, train_period=8, publish_period=1),
    protocol=replace(_FAST.protocol, epoch_steps=10_000, held_out_states=16),
)
"""A run of a second."""
LAMPS = Environment(
    "lamps",
    Lamps.of_run,
    lambda config: own_settings(LampSettings, config.play.env_settings).lamps,
    title="Lamps",
    settings=LampSettings,
)


def test_an_environment_from_outside_is_learned(tmp_path: Path) -> None:
    with added(ENVIRONMENTS, LAMPS):
        summary, policy = learned(CONFIG, tmp_path, steps=240)
    assert (summary["env"], summary["game"]) == ("lamps", "lamps")
    assert summary["agent_steps"] >= 240
    assert summary["updates"] > 0
    assert summary["games"] >= 10
    assert policy.weights_version > 0
    # A third of ten, by chance.
    assert 1 < summary["random_reward"] < 6


class Wrong(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Lamps whose ``wrong`` part is otherwise than the replay takes it to be."""

    def __init__(self, play: PlayConfig, wrong: str) -> None:
        super().__init__(Lamps(play))
        self._wrong = wrong
        if wrong == "actions":
            self.action_space = gymnasium.spaces.Discrete(4)
        if wrong == "no actions":
            del self.unwrapped.action_space

    def reset(self, **how: Any) -> tuple[Any, dict[str, Any]]:
        frames, info = self.env.reset(**how)
        if self._wrong == "first frames":
            frames[0] = 9
        return frames, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        frames, *rest = self.env.step(action)
        if self._wrong == "older frames":
            frames[-2] = 9
        seen = {
            "type": frames / 255,
            "shape": frames[1:],
            "vector": {"frames": frames, "vector": np.zeros(3, np.float32)},
        }
        return seen.get(self._wrong, frames), *rest


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ("actions", "has the actions Discrete(4), and its entry says 3: make them equal."),
        ("no actions", "has the actions None, and its entry says 3: make them equal."),
        ("first frames", "begins an episode with frames that differ: repeat the first one, as"),
        ("older frames", "changes older frames of a state: keep them and append the new one, as"),
        ("type", "gives frames float64 [4, 84, 84]: give uint8 [4, 84, 84]."),
        ("shape", "gives frames uint8 [3, 84, 84]: give uint8 [4, 84, 84]."),
        ("vector", "gives a vector [3], and the settings say [0]: give that one, or change --play"),
    ],
)
def test_what_the_replay_would_store_otherwise_is_refused(wrong: str, sentence: str) -> None:
    entry = Environment("wrong", lambda config, *_, **__: Wrong(config.play, wrong), lambda _: 3)
    policy = Policy(QNetwork(3), 3, np.random.default_rng(1))
    with added(ENVIRONMENTS, entry), pytest.raises(InputError) as error:
        next(play([make_env(replace(CONFIG, env="wrong"), training=True)], policy, [1]))
    assert str(error.value).startswith(f"the environment wrong {sentence}")


def shown(env: gymnasium.Env[Any, Any], *actions: int) -> CheckedEnv:
    """``env`` after these actions of an episode."""
    with added(ENVIRONMENTS, LAMPS):
        checked = CheckedEnv(env, CONFIG)
    checked.reset(seed=1)
    for action in actions:
        checked.step(action)
    return checked


@pytest.mark.parametrize("method", ["reset", "step"])
def test_an_error_of_its_own_is_told_with_its_place(method: str) -> None:
    class Failing(Lamps):
        def fail(self, *_: object, **__: object) -> Any:
            raise KeyError("bulb")

    env = Failing(CONFIG.play)
    setattr(env, method, env.fail)
    told = rf"^{method}\(\) of the environment lamps fails \(KeyError\('bulb'\), .*test_environment"
    with pytest.raises(InputError, match=told + r"\.py:\d+\): mend its package\."):
        shown(env, 1)


def test_a_robot_that_is_lost_is_no_mistake_of_its_environment() -> None:
    """Its actor is started again, because the connection may come back."""

    class Lost(Lamps):
        def step(self, action: Any) -> Any:
            raise ConnectionResetError

    with pytest.raises(ConnectionResetError):
        shown(Lost(CONFIG.play), 1)


@pytest.mark.parametrize("limit", [GAME_STEPS - 1, GAME_STEPS])
def test_a_time_limit_that_passes_as_the_game_ends_is_none(limit: int) -> None:
    """The replay refuses a chunk with a step that is both terminated and truncated."""
    env = shown(gymnasium.wrappers.TimeLimit(Lamps(CONFIG.play), limit))
    ends = [env.step(0)[2:4] for _ in range(limit)]
    assert ends[:-1] == [(False, False)] * (limit - 1)
    assert ends[-1] == (limit == GAME_STEPS, limit < GAME_STEPS)


def test_a_time_limit_ends_the_game_too() -> None:
    """Or it would never be counted, and an evaluation would wait for ever."""
    env = shown(gymnasium.wrappers.TimeLimit(Lamps(CONFIG.play), 3))
    told = [env.step(0)[4]["game_over"] for _ in range(3)]
    assert told == [False, False, True]


def test_a_lost_life_at_a_time_limit_ends_no_game() -> None:
    class OneLifeLost(Lamps):
        def step(self, action: Any) -> Any:
            observation, reward, *_, info = super().step(action)
            return observation, reward, self._steps == 3, False, info

    env = shown(gymnasium.wrappers.TimeLimit(OneLifeLost(CONFIG.play), 3), 0, 0)
    *_, terminated, truncated, info = env.step(0)
    assert (terminated, truncated, info["game_over"]) == (True, False, False)


def test_a_game_may_end_by_being_cut_short() -> None:
    class Cut(Lamps):
        def step(self, action: Any) -> Any:
            observation, reward, terminated, _, info = super().step(action)
            return observation, reward, False, terminated, info

    env = shown(Cut(CONFIG.play), *[0] * (GAME_STEPS - 1))
    *_, terminated, truncated, info = env.step(0)
    assert (terminated, truncated, info["game_over"]) == (False, True, True)


def test_a_game_that_is_over_in_the_middle_of_an_episode_is_refused() -> None:
    class GoesOn(Lamps):
        def step(self, action: Any) -> Any:
            observation, reward, *_, info = super().step(action)
            return observation, reward, False, False, info

    with pytest.raises(InputError, match=r"^the environment lamps goes on after a game is over"):
        shown(GoesOn(CONFIG.play), *[0] * GAME_STEPS)


@pytest.mark.parametrize(
    ("reward", "elapsed", "told"),
    [
        (math.nan, 1, r"gives the reward nan: give a number within ±1e\+09\."),
        (-2e9, 1, r"gives the reward -2000000000\.0: give a number"),
        (1.0, 0, r"says that a step took 0 agent steps: give 1 to 255; 0 is for a reset\."),
        (1.0, 256, r"says that a step took 256 agent steps: give 1 to 255"),
    ],
)
def test_a_step_that_no_chunk_can_carry_is_refused_where_it_is_made(
    reward: float, elapsed: int, told: str
) -> None:
    class Wrong(Lamps):
        def step(self, action: Any) -> Any:
            observation, _, *ends, info = super().step(action)
            return observation, reward, *ends, {**info, "elapsed": elapsed}

    with pytest.raises(InputError, match=f"^the environment lamps {told}"):
        shown(Wrong(CONFIG.play), 1)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (
            {"reward": None},
            r"step\(\) of the environment lamps fails \(TypeError.*: mend its package",
        ),
        ({"observation": [1, 2]}, r"step\(\) of the environment lamps fails \(AttributeError"),
        ({"info": 5}, r"step\(\) of the environment lamps fails \(TypeError"),
        ({"game_score": None}, r"step\(\) of the environment lamps fails \(TypeError"),
        ({"game_steps": math.nan}, r"step\(\) of the environment lamps fails \(ValueError"),
        ({"game_score": math.nan}, r"the environment lamps gives the score nan: give a number"),
        ({"game_score": 2e9}, r"the environment lamps gives the score 2000000000\.0: give a"),
    ],
)
def test_a_step_that_is_malformed_is_refused_in_one_sentence(
    changed: dict[str, Any], told: str
) -> None:
    class Wrong(Lamps):
        def step(self, action: Any) -> Any:
            observation, reward, *ends, info = super().step(action)
            given = {"observation": observation, "reward": reward, "info": info} | changed
            if given["info"] is info:
                given["info"] = info | {key: changed[key] for key in changed.keys() & info.keys()}
            return given["observation"], given["reward"], *ends, given["info"]

    with pytest.raises(InputError, match=f"^{told}"):
        shown(Wrong(CONFIG.play), 1)


@pytest.mark.parametrize("number", [math.nan, math.inf, -2e9])
def test_a_vector_that_no_chunk_can_carry_is_refused_where_it_is_made(number: float) -> None:
    class Wrong(Lamps):
        def reset(self, **settings: Any) -> Any:
            frames, info = super().reset(**settings)
            return {"frames": frames, "vector": np.array([0.0, number], np.float32)}, info

    config = replace(CONFIG, play=replace(CONFIG.play, vector=True))
    with added(ENVIRONMENTS, replace(LAMPS, vector_width=lambda play: 2)):
        env = CheckedEnv(Wrong(config.play), config)
    told = r"^the environment lamps gives a vector with a number that is not within ±1e\+09"
    with pytest.raises(InputError, match=told):
        env.reset(seed=1)


def test_what_it_renders_is_shown_between_margins_and_at_its_own_rate() -> None:
    lamps = Lamps(CONFIG.play, "rgb_array")
    env = shown(lamps, 2)
    assert (env.task, env.actions, env.rate) == ("lamps", (None, None, None), 5)
    picture = env.seen
    assert picture.shape == (90, 120, 3)  # 4:3
    assert (picture[15:75] == lamps.render()).all()
    assert (picture[:15] == picture[0, 0]).all()
    assert (picture[75:] == picture[0, 0]).all()


class Showing(Lamps):
    """One that renders ``picture``, whatever happens, and has no rate."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"]}  # noqa: RUF012

    def __init__(self, picture: Any) -> None:
        super().__init__(CONFIG.play, "rgb_array")
        self.render = lambda: picture  # type: ignore[method-assign]


@pytest.mark.parametrize("rate", [0, -5, float("nan"), float("inf"), "5"])
def test_a_rate_that_is_none_is_refused(rate: Any) -> None:
    env = Lamps(CONFIG.play)
    env.metadata = {"render_fps": rate}
    told = f"^the environment lamps has the render_fps {rate!r}: give the agent steps in a second"
    with pytest.raises(InputError, match=told):
        shown(env)


def test_a_picture_that_is_high_has_its_margins_beside_it() -> None:
    env = shown(Showing(np.full((90, 41, 3), 7, np.uint8)))
    assert env.rate == CONFIG.play.steps_per_second == 15
    assert env.seen.shape == (90, 120, 3)
    assert (env.seen[:, 39:80] == 7).all()
    assert not (env.seen[:, [38, 80]] == 7).any()


@pytest.mark.parametrize(
    ("rendered", "told"),
    [
        (None, "None"),
        (np.zeros((60, 80, 3)), "float64 [60, 80, 3]"),
        (np.zeros((60, 80), np.uint8), "uint8 [60, 80]"),
        (np.zeros((60, 80, 4), np.uint8), "uint8 [60, 80, 4]"),
        ([np.zeros((60, 80, 3), np.uint8)], "uint8 [1, 60, 80, 3]"),
        (np.zeros((60, 0, 3), np.uint8), "uint8 [60, 0, 3]"),
    ],
)
def test_a_picture_that_is_none_is_refused(rendered: Any, told: str) -> None:
    env = shown(Showing(rendered))
    with pytest.raises(InputError) as error:
        _ = env.seen
    assert str(error.value) == (
        f"the environment lamps renders {told}: give uint8 [rows, columns, 3]."
    )


def test_one_that_cannot_render_is_told_where() -> None:
    class Blind(Lamps):
        def render(self) -> Any:
            raise KeyError("display")

    told = r"^render\(\) of the environment lamps fails \(KeyError\('display'\), .*test_environment"
    with pytest.raises(InputError, match=told):
        _ = shown(Blind(CONFIG.play, "rgb_array")).seen


def test_one_that_renders_nothing_shows_its_newest_frame() -> None:
    env = shown(Lamps(CONFIG.play), 1, 2)
    frame = env.step(0)[0][-1]
    assert env.seen.shape == (84, 112, 3)
    assert (env.seen[:, 14:98] == frame[:, :, None]).all()
    assert not (env.seen[:, [13, 98]] == 0).any()  # margins are not of its black


def test_it_goes_by_its_own_name() -> None:
    with added(ENVIRONMENTS, LAMPS):
        assert (CONFIG.task, CONFIG.played) == ("lamps", "lamps")
        assert run_name(LearnerOptions(config=CONFIG)) == "lamps-fast"
    robot = replace(PRESETS["robot"], game="space_invaders")
    assert (robot.task, robot.played) == ("space_invaders", "space_invaders (robot)")
    assert run_name(LearnerOptions(config=robot)) == "robot-space-invaders-robot"


def test_pages_and_screens_name_no_game_of_it() -> None:
    told = snapshot({"run/env": "lamps", "run/game": "lamps"})
    pong = snapshot({"run/env": "ale", "run/game": "pong"})
    with added(ENVIRONMENTS, LAMPS):
        assert screen(told).startswith("Lamps  run pong-1")
        assert (figures(told)["run"]["env"], figures(told)["run"]["game"]) == ("Lamps", "")
    assert screen(pong).startswith("ALE-Only  pong  run pong-1")
    assert figures(pong)["run"]["game"] == "pong"


def screen(told: Snapshot) -> str:
    out = io.StringIO()
    Console(file=out, width=120, height=24).print(Screen(told))
    return out.getvalue().strip()


def test_an_environment_has_settings_of_its_own(tmp_path: Path) -> None:
    config = replace(CONFIG, play=replace(CONFIG.play, env_settings="lamps=7"))
    with added(ENVIRONMENTS, LAMPS):
        assert config.action_count == 7
        summary, _ = learned(config, tmp_path, steps=240)
    assert summary["updates"] > 0


def test_an_actor_that_asks_for_an_atari_game_does_not_join_it() -> None:
    config = replace(PRESETS["fast"], env="lamps")
    with added(ENVIRONMENTS, LAMPS):
        ActorOptions(env="lamps", game="lamps").check_against(config)
        with pytest.raises(InputError, match="plays lamps, not pong: omit --game"):
            ActorOptions(game=config.game).check_against(config)


def test_settings_of_its_own_are_checked_with_the_others() -> None:
    with added(ENVIRONMENTS, LAMPS):
        for wrong, sentence in (
            ("lamps=8", "play.env_settings.lamps is 8: choose at most 7."),
            ("lamp=4", "play.env_settings has no 'lamp': did you mean lamps?"),
        ):
            config = replace(CONFIG, play=replace(CONFIG.play, env_settings=wrong))
            with pytest.raises(InputError) as error:
                check_config(config)
            assert str(error.value) == sentence


def test_an_entry_whose_actions_cannot_be_counted_is_refused() -> None:
    entry = replace(LAMPS, actions=3)  # type: ignore[arg-type]
    with added(ENVIRONMENTS, entry), pytest.raises(InputError) as error:
        check_config(CONFIG)
    assert str(error.value).startswith("`actions` of the environment 'lamps' fails (TypeError(")


def test_its_own_rate_counts_its_seconds(tmp_path: Path) -> None:
    """Five agent steps in a second, and 15 by the settings of the console."""
    with added(ENVIRONMENTS, LAMPS):
        weights = tmp_path / "w.safetensors"
        weights.write_bytes(encode_network_file(build_network(CONFIG, 3), CONFIG))
        (game,) = games(CONFIG, GamesOptions(weights, "", 8, 0.5), threading.Event())
        assert game["game_seconds"] == pytest.approx(GAME_STEPS / 5)
        with closing(Recorder(CheckedEnv(Lamps(CONFIG.play), CONFIG), CONFIG, tmp_path / "d")) as r:
            assert r.dataset.rate == 5
