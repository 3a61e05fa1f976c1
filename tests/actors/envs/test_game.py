"""The rules of games and episodes, which emulator and robot share."""

from collections import Counter
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from actors.envs.emulator import Emulator
from actors.envs.game import AtariGame
from common.settings.conditions import PlayConfig

_NO_START = PlayConfig(random_starts=0)


def _begin(game: AtariGame, seed: int = 0, *, seeded: bool = False, **options: bool) -> bool:
    return game.begin_episode(np.random.default_rng(seed), seeded=seeded, options=options)


def _decide(game: AtariGame, action: int) -> tuple[float, bool, bool]:
    points = sum(game.hold(action) for _ in range(4))
    return points, *game.end_agent_step()


def _until_end(game: AtariGame, action: int = 1) -> tuple[bool, bool]:
    while True:
        _, terminated, truncated = _decide(game, action)
        if terminated or truncated:
            return terminated, truncated


def test_a_lost_life_ends_the_episode_in_training_and_the_game_goes_on() -> None:
    game = AtariGame("breakout", _NO_START, training=True)
    assert _begin(game)
    for lives_left in (4, 3, 2, 1):
        assert _until_end(game) == (True, False)
        assert game.emulator.lives == lives_left
        assert not game.over
        score, steps, ram = game.score, game.steps, game.emulator.ram()
        assert not _begin(game)
        assert (game.score, game.steps) == (score, steps)
        assert np.array_equal(game.emulator.ram(), ram)
    assert _until_end(game) == (True, False)
    assert game.over
    assert _begin(game)
    assert (game.score, game.steps, game.emulator.lives, game.over) == (0, 0, 5, False)


def test_in_evaluation_only_game_over_ends_the_episode() -> None:
    game = AtariGame("breakout", _NO_START, training=False)
    _begin(game)
    assert _until_end(game) == (True, False)
    assert game.emulator.game_over
    assert game.over


def test_a_new_game_is_forced_by_seed_option_or_a_reset_in_between() -> None:
    for how in ({"seeded": True}, {"new_game": True}):
        game = AtariGame("breakout", _NO_START, training=True)
        _begin(game)
        _until_end(game)
        assert _begin(game, **how)
        assert game.emulator.lives == 5
    _decide(game, 1)
    assert _begin(game)  # in the middle of an episode
    _until_end(game)
    assert not _begin(game)
    assert _begin(game)  # an episode that was carried on, but not played


def test_a_long_game_is_cut_and_then_starts_anew() -> None:
    game = AtariGame("pong", PlayConfig(random_starts=0, max_game_frames=100), training=True)
    _begin(game)
    for agent_step in range(1, 26):
        _, terminated, truncated = _decide(game, 0)
        assert (terminated, truncated, game.over) == (False, agent_step == 25, agent_step == 25)
    assert _begin(game)
    assert game.steps == game.emulator.frames == 0
    endless = AtariGame("pong", PlayConfig(random_starts=0, max_game_frames=0), training=True)
    _begin(endless)
    assert not any(any(_decide(endless, 0)[1:]) for _ in range(200))


def test_a_life_lost_as_the_game_is_cut_is_terminated_and_over() -> None:
    probe = AtariGame("breakout", _NO_START, training=True)
    _begin(probe)
    _until_end(probe)
    play = PlayConfig(random_starts=0, max_game_frames=probe.emulator.frames)
    training = AtariGame("breakout", play, training=True)
    _begin(training)
    assert _until_end(training) == (True, False)
    assert training.over
    assert _begin(training)
    evaluation = AtariGame("breakout", play, training=False)
    _begin(evaluation)
    assert _until_end(evaluation) == (False, True)


def test_random_starts_are_uniform_from_none_to_the_most() -> None:
    game = AtariGame("breakout", PlayConfig(random_starts=3), training=True)
    rng = np.random.default_rng(0)
    lengths: Counter[int] = Counter()
    for _ in range(200):
        game.start_anew(rng)
        assert game.emulator.frames == 4 * game.steps
        lengths[game.steps] += 1
    assert set(lengths) == {0, 1, 2, 3}
    assert min(lengths.values()) > 25  # 50 expected


def test_points_of_the_random_start_count() -> None:
    # Long enough for Pong's computer to score; the same draws by hand on another emulator.
    play = PlayConfig(random_starts=200, minimal_actions=True)
    game = AtariGame("pong", play, training=True)
    scored = 0
    for seed in range(4):
        _begin(game, seed, seeded=True)
        rng = np.random.default_rng(seed)
        actions = rng.choice((0, 1, 3, 4, 11, 12), rng.integers(201))
        emulator = Emulator("pong", 0)
        assert game.steps == len(actions)
        assert game.score == sum(emulator.act(int(action)) for action in actions.repeat(4))
        scored += game.score != 0
    assert scored


def test_a_random_start_that_ends_the_game_begins_again_from_the_beginning() -> None:
    play = PlayConfig(random_starts=2_000, minimal_actions=True)
    game = AtariGame("breakout", play, training=True)
    _begin(game)
    assert (game.steps, game.score, game.emulator.frames, game.emulator.lives) == (0, 0, 0, 5)
    assert not game.emulator.game_over


def test_a_life_that_is_won_ends_no_episode_but_its_loss_does() -> None:
    """However many lives are left: the last of these steps ends with as many as it began with."""
    game = AtariGame("breakout", _NO_START, training=True)
    _begin(game)
    lives = iter([5, 6, 6, 6, 6, 5, 5, 6])

    def act(action: int) -> float:
        console.lives = next(lives)
        return 0.0

    console: Any = SimpleNamespace(act=act, game_over=False, frames=4)
    game.emulator = console
    assert _decide(game, 0) == (0.0, False, False)
    assert _decide(game, 0) == (0.0, True, False)
    assert not game.over


def test_nothing_is_scored_after_game_over() -> None:
    game = AtariGame("breakout", _NO_START, training=False)
    _begin(game)
    _until_end(game)
    frames = game.emulator.frames
    assert game.hold(1) == 0
    assert game.emulator.frames == frames


def _trace(game: AtariGame, seed: int) -> list[bytes]:
    _begin(game, seed, seeded=True)
    trace = []
    for step in range(60):
        _decide(game, step % 18)
        trace.append(game.emulator.ram().tobytes())
    return trace


@pytest.mark.parametrize("name", ["freeway", "kaboom"])
def test_a_seed_starts_the_same_game_whatever_was_played_before(name: str) -> None:
    # These games keep memory across ALE's reset; only power-on clears it.
    game = AtariGame(name, PlayConfig(), training=True)
    assert _trace(game, 7) == _trace(game, 7)


def test_a_seed_decides_which_actions_stick() -> None:
    play = PlayConfig(random_starts=0, sticky=0.25)
    game = AtariGame("pong", play, training=True)
    first = _trace(game, 7)
    assert _trace(game, 8) != first
    assert _trace(game, 7) == first
    assert _trace(AtariGame("pong", play, training=True), 7) == first


def test_without_a_seed_other_actions_stick_in_each_game() -> None:
    play = PlayConfig(random_starts=0, sticky=0.25)
    traces = []
    for seed in (1, 2):
        game = AtariGame("pong", play, training=True)
        rng = np.random.default_rng(seed)
        for _ in range(2):
            game.start_anew(rng)
            traces.append(
                [_decide(game, step % 18) and game.emulator.ram().tobytes() for step in range(60)]
            )
    assert len({tuple(trace) for trace in traces}) == 4


def test_where_nothing_sticks_games_are_what_they_were() -> None:
    """Their generator draws the random start first, as it did before there was --play.sticky."""
    game = AtariGame("pong", PlayConfig(random_starts=30), training=True)
    _begin(game, 3, seeded=True)
    rng = np.random.default_rng(3)
    actions = rng.choice(range(18), rng.integers(31))
    assert game.steps == len(actions) > 0
