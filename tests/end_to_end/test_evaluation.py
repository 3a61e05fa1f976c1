"""`python -m learner.evaluation`: whole games by a network on disk, in several processes."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.network import LAYERS, build_network
from common.protocol.weights import encode_weights
from common.run.folder import RunFolder
from common.settings.presets import PRESETS
from tests.end_to_end.conftest import Stage
from tests.paths import ROOT
from tests.tiny_network import TINY


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run's folder with fresh weights in it."""
    monkeypatch.setitem(LAYERS, "nips", TINY)
    fast = PRESETS["fast"]
    config = replace(fast, learning=replace(fast.learning, network="nips"))
    folder = RunFolder(tmp_path, "fresh")
    folder.claim("learner", config, resume=False)
    folder.snapshots.mkdir()
    (folder.snapshots / "best.safetensors").write_bytes(encode_weights(build_network(config, 6)))
    return folder.path


def _evaluate(stage: Stage, *arguments: object, status: int = 0) -> str:
    """What the command prints."""
    return stage.start("-m", "learner.evaluation", *map(str, arguments)).ends(status)


def test_games_are_played_to_their_ends_and_summed_up(
    run: Path, tmp_path: Path, stage: Stage
) -> None:
    weights = run / "snapshots" / "best.safetensors"

    def played(name: str) -> dict[str, Any]:
        told = ("--play.sticky", 0.25, "--json", tmp_path / name)
        printed = _evaluate(stage, weights, "--games", 3, "--processes", 2, *told)
        assert "interquartile mean" in printed
        content: dict[str, Any] = json.loads((tmp_path / name).read_text())
        return content

    first = played("first.json")
    assert (first["games"], len(first["scores"]), first["epsilon"]) == (3, 3, 0.001)
    assert first["mean"] == np.mean(first["scores"])
    # A game of Pong ends when somebody has 21 points: no fewer than 21 points were played for.
    assert all(-21 <= score <= 21 and abs(score) >= 1 for score in first["scores"])
    assert first["steps"] == sum(first["steps_of_games"]) > 3 * 500
    assert (first["press_match_share"], first["valid_frame_share"]) == (1.0, 1.0)
    # A bare emulator has no hands to time.
    nothing = {"measured": 0, "p50": None, "p99": None, "watched": 0.0, "given_up": None}
    assert first["press_ms"] == first["release_ms"] == nothing
    # The same seed plays the same games, in whatever order the processes end them.
    again = played("again.json")
    assert sorted(again["game_hashes"]) == sorted(first["game_hashes"])
    assert (first["distinct_games"], len(set(first["game_hashes"]))) == (3, 3)
    assert (first["speed"], first["deadlines_kept_share"]) == (None, None)
    assert first["game_seconds"] == pytest.approx(first["steps"] / 15)


def test_without_chance_every_game_is_the_same_one_and_sticky_actions_change_that(
    tmp_path: Path, stage: Stage
) -> None:
    policy = ROOT / "policies" / "ale_pong.safetensors"
    still = ("--play.random-starts", 0, "--play.max-game-frames", 480, "--epsilon", 0)

    def played(*flags: object) -> dict[str, Any]:
        file = tmp_path / "found.json"
        _evaluate(stage, policy, *still, "--games", 4, "--processes", 2, "--json", file, *flags)
        content: dict[str, Any] = json.loads(file.read_text())
        return content

    found = played()
    assert (found["distinct_games"], found["distinct_endings"], found["same_ending"]) == (1, 1, 4)
    sticky = played("--play.sticky", 0.25)
    assert (sticky["sticky"], sticky["distinct_games"]) == (0.25, 4)
    assert "play.sticky 0.0 → 0.25" in sticky["changed"]


def test_settings_other_than_the_runs_are_played_under_and_told(
    run: Path, tmp_path: Path, stage: Stage
) -> None:
    weights = run / "snapshots" / "best.safetensors"
    short = ("--play.max-game-frames", 400, "--play.random-starts", 0)
    late = ("--play.press-latency", 3, "--play.actuation-latency", 4)
    random = ("--games", 2, "--epsilon", 1)  # a fresh network may press nothing at all
    printed = _evaluate(stage, weights, *random, *short, *late, "--json", tmp_path / "late.json")
    content = json.loads((tmp_path / "late.json").read_text())
    assert content["steps_of_games"] == [100, 100]
    changes = [
        "play.random_starts 30 → 0",
        "play.max_game_frames 108000 → 400",
        "play.press_latency 0 → 3",
        "play.actuation_latency 0 → 4",
    ]
    assert content["changed"] == changes
    told = " ".join(printed.split())
    assert all(f"other than trained │ {change}" in told for change in changes)
    # An agent step's keys are those of the command before: the same for one in six.
    assert 0 < content["press_match_share"] < 0.5


def test_what_does_not_fit_other_settings_is_told(run: Path, stage: Stage) -> None:
    for flag, words in (
        ("--play.no-minimal-actions", "give --play.minimal-actions."),
        ("--play.vector", "trained with 0 numbers of proprioception"),
    ):
        assert words in _evaluate(stage, run / "snapshots" / "best.safetensors", flag, status=2)


def test_the_former_command_still_evaluates(run: Path, stage: Stage) -> None:
    weights = str(run / "snapshots" / "best.safetensors")
    short = ("--games", "1", "--play.max-game-frames", "400")
    told = stage.start("-m", "learner", "--evaluate", weights, *short).ends(0)
    assert "interquartile mean" in told


def test_what_is_no_network_is_told(run: Path, tmp_path: Path, stage: Stage) -> None:
    for weights, why in (
        (
            tmp_path / "nothing",
            "does not exist: name a network's file, a run, or a published policy: ale_",
        ),
        (run / "config.json", "holds no network"),
    ):
        printed = _evaluate(stage, weights, status=2)
        assert why in printed
        assert printed.strip().startswith("error: ")
        assert printed.strip().count("\n") == 0
