"""Games are told apart by what their consoles remember, from one agent step to the next."""

import hashlib
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

from actors.envs import make_env
from actors.envs.step_info import StepInfo
from actors.game_recorder import GameRecorder
from common.settings.clock import ClockConfig
from common.settings.presets import PRESETS


class ScriptedGame(gymnasium.Env[Any, Any]):
    """Its newest frame shows at each agent step the next number of the script. Each script is an
    episode, and at its end the game is over, unless more of its ``lives`` are left."""

    def __init__(self, *scripts: list[int], lives: int = 1) -> None:
        self._scripts = iter(scripts)
        self._lives = lives
        self._lost = 0

    def reset(self, **how: Any) -> tuple[Any, dict[str, Any]]:
        self._script = [*next(self._scripts)]
        return self._state(200), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        state, ended = self._state(self._script.pop(0)), not self._script
        self._lost += ended
        over = ended and self._lost % self._lives == 0
        return state, 0.0, ended, False, StepInfo(over, 0.0, 1)._asdict()

    def _state(self, number: int) -> Any:
        frames = np.zeros((4, 84, 84), np.uint8)
        frames[-1] = number
        return {"frames": frames, "vector": np.zeros(3)}


class ScriptedConsole(ScriptedGame):
    """Its memory holds the number, and its frames show nothing of it."""

    def _state(self, number: int) -> Any:
        self._number = number
        return np.zeros((4, 84, 84), np.uint8)

    def ram(self) -> NDArray[np.uint8]:
        return np.full(128, self._number, np.uint8)


def hashes(env: gymnasium.Env[Any, Any], ending: int, *lengths: int) -> list[tuple[str, str]]:
    """Hashes of games of so many steps: of all, and of the last ``ending``."""
    recorder, found = GameRecorder(env, ending), []
    for length in lengths:
        recorder.reset()
        for _ in range(length):
            recorder.step(0)
        found.append((recorder.game_hash, recorder.ending_hash))
    return found


def test_equal_games_have_equal_hashes_and_others_do_not() -> None:
    games = [[1, 2, 3], [1, 2, 3], [1, 3, 2], [1, 2], [1, 2, 3, 3]]
    found = hashes(ScriptedConsole(*games), 800, 3, 3, 3, 2, 4)
    for hashed in zip(*found, strict=True):  # whole games, and endings that are longer than they
        assert hashed[0] == hashed[1]
        assert len(set(hashed)) == 4


def test_games_may_differ_and_end_alike() -> None:
    games = [[1, 2, 3, 4], [9, 2, 3, 4], [1, 9, 3, 4], [2, 3, 4]]
    found = hashes(ScriptedConsole(*games), 3, 4, 4, 4, 3)
    assert len({game for game, _ in found}) == 4
    endings = [ending for _, ending in found]
    assert endings[0] == endings[1] == endings[3] != endings[2]


def test_without_a_console_the_newest_frame_tells_games_apart() -> None:
    first, second, third = hashes(ScriptedGame([1, 2], [1, 2], [1, 3]), 1, 2, 2, 2)
    assert first == second
    assert all(ours != theirs for ours, theirs in zip(first, third, strict=True))


def test_a_game_lasts_from_its_reset_to_its_last_step() -> None:
    times = iter([10.0, 11.0, 13.5, 20.0, 20.25])
    recorder = GameRecorder(ScriptedConsole([1, 2], [3]), 1, now=lambda: next(times))
    for steps, seconds in ((2, 3.5), (1, 0.25)):
        recorder.reset()
        for _ in range(steps):
            recorder.step(0)
        assert recorder.seconds == seconds


def test_a_game_of_several_episodes_is_one_game() -> None:
    whole = hashes(ScriptedConsole([1, 2, 3, 4], [1, 2, 3, 5]), 3, 4, 4)
    times = iter([10.0, 11.0, 12.0, 20.0, 21.5, 30.0, 31.0, 32.0, 33.0, 34.0])
    game = ScriptedConsole([1, 2], [3, 4], [1, 2], [3, 5], lives=2)
    recorder, found = GameRecorder(game, 3, now=lambda: next(times)), []
    for seconds in (11.5, 4.0):
        for _ in range(2):
            recorder.reset()
            recorder.step(0)
            recorder.step(0)
        found.append((recorder.game_hash, recorder.ending_hash))
        assert recorder.seconds == seconds
    assert found == whole


@pytest.mark.parametrize("sync", [True, False])
@pytest.mark.parametrize("env", ["ale", "robot"])
def test_the_memory_is_that_of_the_environments_console(env: str, sync: bool) -> None:
    preset = PRESETS["fast" if env == "ale" else "robot"]
    playing: Any = make_env(preset, ClockConfig(sync=sync), training=False)
    recorder = GameRecorder(playing, 5)
    recorder.reset(seed=3)
    recorder.step(2)
    if sync or env == "ale":  # else the world has gone on
        memory = playing.emulator.ram().tobytes()
        assert recorder.game_hash == hashlib.blake2b(memory, digest_size=8).hexdigest()
    assert playing.ram().shape == (128,)
    playing.close()
