"""What recorded games tell of hands, by latency models whose function is known."""

import itertools
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actors.envs import make_env
from actors.loop import play as play_games
from actors.policy import Policy
from actors.robots.latency_model import fit
from actors.robots.latency_model.played import played
from actors.robots.latency_model.recording import Recording, inputs
from actors.robots.latency_model.weights import COMMANDS, ModelWeights
from common.dataset.reader import Dataset
from common.errors import InputError
from common.network import build_network
from common.pinned_file import pin
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from common.settings.ranges import NOTHING_DRAWN, RandomiseConfig
from tests.actors.robots.latency_model.models import Arrays, delay, drawn, saved
from viewer.recorder import Recorder

PLAY = replace(
    PRESETS["fast"].play, vector=True, vector_key_frames=6, robot_settings="rate=60", sticky=0.25
)

WEIGHTS = ModelWeights(**delay(5))  # type: ignore[arg-type]


def games(
    folder: Path,
    robot: str,
    steps: int = 120,
    randomise: RandomiseConfig = NOTHING_DRAWN,
    **others: Any,
) -> RunConfig:
    """Records random play by the hands of ``robot``, in games of 60 steps."""
    changed: dict[str, Any] = {"max_game_frames": 240, "robot": robot} | others
    config = replace(PRESETS["fast"], play=replace(PLAY, **changed), randomise=randomise)
    rng = np.random.default_rng(0)
    policy = Policy(build_network(config, config.action_count), config.action_count, rng)
    env = make_env(config, training=True)
    with closing(Recorder(env, config, folder)) as recorder:
        for step in itertools.islice(play_games([recorder], policy, [0]), steps):
            recorder.add(step)
    return config


def by_the_model(arrays: Arrays, found: Recording) -> list[int]:
    """What the model holds in each frame whose whole past is known."""
    columns = inputs(found)[found.known_from :]
    hidden = arrays["fc_weight"].T[columns].sum(axis=1, dtype=np.float64) + arrays["fc_bias"]
    values = np.maximum(hidden, 0) @ arrays["pred_weight"].T + arrays["pred_bias"]
    found_actions: list[int] = values.argmax(axis=1).tolist()
    return found_actions


@pytest.mark.parametrize("arrays", [delay(5), drawn(7, 1)], ids=["late", "any"])
@pytest.mark.parametrize("others", [{}, {"minimal_actions": False, "vector_key_frames": 4}])
def test_commands_and_keys_of_a_game_are_those_of_its_hands(
    tmp_path: Path, arrays: Arrays, others: dict[str, Any]
) -> None:
    robot = pin(saved(tmp_path / "arm.npz", arrays))
    games(tmp_path / "d", robot, **others)
    found = played(tmp_path / "d", robot, "rate=60")
    assert len(found) >= 2
    assert sum(len(game.held) for game in found) >= 4 * (120 - len(found))
    for game in found:
        assert game.known_from == min(COMMANDS, len(game.held))
        assert by_the_model(arrays, game) == game.held[COMMANDS:].tolist()
    assert len(set(found[0].held[COMMANDS:].tolist())) > 2


def test_a_model_learns_from_random_commands_and_from_games(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, file = saved(tmp_path / "arm.npz", delay(5)), tmp_path / "model.npz"
    games(tmp_path / "d", pin(robot))
    seen: list[list[Recording]] = []

    def learn(recordings: list[Recording], *others: object) -> ModelWeights:
        seen.append(recordings)
        return WEIGHTS

    monkeypatch.setattr(fit, "fit", learn)
    hands = ["--robot", robot, "--play.robot-settings", "rate=60"]
    command = ["fit", "-o", str(file), "--steps", "50", "--recordings", str(tmp_path / "d"), *hands]
    monkeypatch.setattr(sys, "argv", command)
    fit.main()
    assert file.exists()
    ((*of_games, of_commands),) = seen
    assert len(of_games) >= 2
    assert of_games[0].known_from == COMMANDS
    assert (of_commands.known_from, len(of_commands.held)) == (0, 200)


def test_drawn_latency_is_refused_as_a_constant_one(tmp_path: Path) -> None:
    robot = pin(saved(tmp_path / "arm.npz", delay(1)))
    games(tmp_path / "d", robot, 40, randomise=RandomiseConfig(actuation_latency=3))
    with pytest.raises(InputError, match=r"without --play.actuation-latency and its range"):
        played(tmp_path / "d", robot, "rate=60")


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("actions", 6, "d is damaged: an action or a key"),
        ("vectors", 0.5, "d is damaged: an action or a key"),
        ("vectors", np.nan, "d is damaged: an action or a key"),
        ("elapsed", 2, "d has a game that waited for its keys: record without --wait-action"),
    ],
)
def test_rows_that_cannot_be_are_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, column: str, value: float, words: str
) -> None:
    robot = pin(saved(tmp_path / "arm.npz", delay(1)))
    games(tmp_path / "d", robot, 40)
    (rows,) = Dataset(tmp_path / "d").read()
    rows[column][-1] = value
    monkeypatch.setattr(Dataset, "read", lambda dataset: iter([rows]))
    with pytest.raises(InputError, match=words):
        played(tmp_path / "d", robot, "rate=60")


def test_a_game_of_one_step_tells_nothing(tmp_path: Path) -> None:
    robot = pin(saved(tmp_path / "arm.npz", delay(1)))
    games(tmp_path / "d", robot, 1)
    assert played(tmp_path / "d", robot, "rate=60") == []


@pytest.mark.parametrize(
    ("others", "words"),
    [
        ({"vector": False}, "does not show the keys of every frame: record games with --play.vec"),
        ({"vector_key_frames": 3}, "does not show the keys of every frame"),
        ({"frame_skip": 2}, "does not show the keys of every frame"),
        ({"actuation_latency": 2}, "with late commands: record games without --play.actuation-lat"),
        ({"actuation_jitter": 2}, "record games without --play.actuation-jitter"),
        ({"equal_latency": 8}, "record games without --play.equal-latency"),
        ({"robot_settings": "rate=30"}, "was not played by the hands of .*arm.npz"),
        ({"robot": "nao", "robot_settings": ""}, "was not played by the hands of"),
    ],
)
def test_games_that_do_not_show_these_hands_are_refused(
    tmp_path: Path, others: dict[str, Any], words: str
) -> None:
    robot = pin(saved(tmp_path / "arm.npz", delay(1)))
    games(tmp_path / "d", others.pop("robot", robot), 40, **others)
    with pytest.raises(InputError, match=words):
        played(tmp_path / "d", robot, "rate=60")


def test_only_the_first_frames_of_a_game_are_left_out(tmp_path: Path) -> None:
    """The model learns from each frame whose past is known, and from no other."""
    rng = np.random.default_rng(0)
    wanted = rng.integers(18, size=400)
    game = Recording(wanted, np.concatenate([[5], wanted[:-1]]), known_from=399)
    other = Recording(np.zeros(200, np.int64), np.full(200, 3))
    weights = fit.fit([game, other], hidden=4, seed=0)
    # One frame against two hundred: nothing else in the game counts.
    assert fit.differing(weights, other) == 0
