"""`python -m learner --evaluate`: whole games by a network on disk, in several processes."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.network import build_network
from common.protocol.weights import encode_weights
from common.run.folder import RunFolder
from common.run.presets import PRESETS
from tests.paths import ROOT
from tests.patience import PATIENCE


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run's folder with fresh weights in it."""
    config = PRESETS["fast"]
    folder = RunFolder(tmp_path, "fresh")
    folder.claim("learner", config, begun=folder.checkpoint, resume=False)
    folder.snapshots.mkdir()
    (folder.snapshots / "best.safetensors").write_bytes(encode_weights(build_network(config, 6)))
    return folder.path


def _evaluate(*arguments: object) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "learner", "--evaluate", *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=PATIENCE, stdin=subprocess.DEVNULL
    )


def test_games_are_played_to_their_ends_and_summed_up(run: Path, tmp_path: Path) -> None:
    weights = run / "snapshots" / "best.safetensors"

    def played(name: str) -> dict[str, Any]:
        told = ("--play.sticky", 0.25, "--json", tmp_path / name)
        ended = _evaluate(weights, "--games", 3, "--processes", 2, *told)
        assert ended.returncode == 0, ended.stderr
        assert "interquartile mean" in ended.stdout
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
    tmp_path: Path,
) -> None:
    policy = ROOT / "policies" / "ale_pong.safetensors"
    still = ("--play.random-starts", 0, "--play.max-game-frames", 1_200, "--epsilon", 0)

    def played(*flags: object) -> dict[str, Any]:
        file = tmp_path / "found.json"
        ended = _evaluate(policy, *still, "--games", 4, "--processes", 2, "--json", file, *flags)
        assert ended.returncode == 0, ended.stderr
        content: dict[str, Any] = json.loads(file.read_text())
        return content

    found = played()
    assert (found["distinct_games"], found["distinct_endings"], found["same_ending"]) == (1, 1, 4)
    sticky = played("--play.sticky", 0.25)
    assert (sticky["sticky"], sticky["distinct_games"]) == (0.25, 4)
    assert "play.sticky 0.0 → 0.25" in sticky["changed"]


def test_settings_other_than_the_runs_are_played_under_and_told(run: Path, tmp_path: Path) -> None:
    weights = run / "snapshots" / "best.safetensors"
    short = ("--play.max-game-frames", 400, "--play.random-starts", 0)
    late = ("--play.command-latency", 1, "--play.press-latency", 3)
    random = ("--games", 2, "--epsilon", 1)  # a fresh network may press nothing at all
    ended = _evaluate(weights, *random, *short, *late, "--json", tmp_path / "late.json")
    assert ended.returncode == 0, ended.stderr
    content = json.loads((tmp_path / "late.json").read_text())
    assert content["steps_of_games"] == [100, 100]
    changes = [
        "play.random_starts 30 → 0",
        "play.max_game_frames 108000 → 400",
        "play.command_latency 0 → 1",
        "play.press_latency 0 → 3",
    ]
    assert content["changed"] == changes
    told = " ".join(ended.stdout.split())
    assert all(f"other than trained │ {change}" in told for change in changes)
    # An agent step's keys are those of the command before: the same for one in six.
    assert 0 < content["press_match_share"] < 0.5


def test_what_does_not_fit_other_settings_is_told(run: Path) -> None:
    for flag, words in (
        ("--play.no-minimal-actions", "add --play.minimal-actions."),
        ("--play.vector", "trained with 0 numbers of proprioception"),
    ):
        ended = _evaluate(run / "snapshots" / "best.safetensors", flag)
        assert ended.returncode == 2
        assert words in ended.stderr


def test_what_is_no_network_is_told(run: Path, tmp_path: Path) -> None:
    for weights, why in (
        (tmp_path / "nothing", "is not a file: name a network to evaluate"),
        (run / "config.json", "not safetensors"),
    ):
        ended = _evaluate(weights)
        assert ended.returncode == 2
        assert why in ended.stderr
        assert ended.stderr.count("\n") == 1
