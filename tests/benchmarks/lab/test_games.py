"""`benchmarks.lab.games`: a robot and its twin on each game, and what the body costs."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.figures.plot import FIGURES
from benchmarks.lab import games, policy
from benchmarks.lab.policy import summary_of_all
from benchmarks.report import run
from common.command_line.run_options import parse_run
from common.errors import InputError
from common.run.epochs import EpochTable
from common.run.folder import RunFolder
from learner.figures.plot import Options as Drawing
from learner.options import LearnerOptions
from tests.epoch_rows import epoch_row

SCORES = {("pong", "ale"): 19.0, ("pong", "robot"): 9.0, ("seaquest", "ale"): 60.0}
"""Mean scores of the last weights without sticky actions; all other runs have 50."""


class Lab:
    """Trainings and evaluations that only write down what they were asked for."""

    def __init__(self) -> None:
        self.trained: list[tuple[str, str]] = []
        self.left = 10**6
        self.steps = 2_000
        self.random: float | None = -21.0

    def train(self, folder: RunFolder, steps: int, flags: Sequence[str]) -> dict[str, Any]:
        if not self.left:
            raise KeyboardInterrupt
        self.left -= 1
        given = parse_run(LearnerOptions, "learner", flags, lambda _: None)
        config = given.config
        assert (steps, config.preset, config.seed, given.evaluators) == (2_000, "robot", 7, 0)
        self.trained.append((config.game, config.env))
        folder.path.mkdir(parents=True)
        folder.checkpoint.write_text(f"{config.game} {config.env}")
        summary = {
            **{"agent_steps": self.steps, "wall_seconds": 42.0, "random_reward": self.random},
            **{"git_commit": "c0ffee", "git_dirty": False, "machine": {"cpu": "one"}},
        }
        folder.summary.write_text(json.dumps(summary))
        table = EpochTable(folder.epochs)
        table.append(epoch_row([self.random or 0.0], phase="random"))
        for epoch, score in enumerate((-20.0, 5.0), 1):
            table.append(
                epoch_row([score], epoch=epoch, phase="train", total_train_steps=800 * epoch)
            )
        return summary_of_all(folder, steps)

    def evaluate(
        self, network: Path, number: int, epsilon: None, flags: Sequence[str], *, quiet: bool
    ) -> dict[str, Any]:
        assert (number, epsilon, flags) == (30, None, ["--headline"])
        game, env = network.read_text().split()
        mean = SCORES.get((game, env), 50.0)
        row = {"epsilon": 0.001, "sticky": 0.0, "mean": mean, "deviation": 1.5, "scores": [mean]}
        row |= {"iqm": mean, "distinct_games": 1, "steps": 700, "decisions": 700}
        return {"rows": [row, {**row, "sticky": 0.25, "mean": mean - 30.0}]}


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch) -> Lab:
    lab = Lab()
    monkeypatch.setenv("COLUMNS", "160")  # no cell in two lines
    monkeypatch.setattr(policy, "evaluate", lab.evaluate)
    monkeypatch.setattr(games, "train", lab.train)
    return lab


def played(folder: Path, *flags: str) -> dict[str, Any]:
    file = folder / "games.json"
    given = ["--steps", "2000", "--seed", "7", "--runs", str(folder), "--json", str(file), *flags]
    run("lab.games", games.Options, games.measure, given)
    content: dict[str, Any] = json.loads(file.read_bytes())
    return content


def test_share_of_rise_by_hand() -> None:
    assert games.share_of_rise(-21.0, 19.0, 9.0) == 0.75
    assert games.share_of_rise(0.0, 50.0, 60.0) == 1.2
    assert games.share_of_rise(0.0, 50.0, -10.0) == -0.2
    assert games.share_of_rise(10.0, 10.0, 20.0) is None
    assert games.share_of_rise(None, 10.0, 20.0) is None


def test_a_robot_is_compared_with_its_twin(
    lab: Lab, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = played(tmp_path, "--game", "pong", "seaquest")
    assert lab.trained == [(g, e) for g in ("pong", "seaquest") for e in ("ale", "robot")]
    assert [run["curve"] for run in content["runs"]] == 4 * [[[800, -20.0], [1600, 5.0]]]
    first = content["runs"][0]["headline"][0]
    assert (first["distinct_games"], first["steps"]) == (1, 700)
    said = capsys.readouterr().out
    pong = next(line for line in said.splitlines() if "pong" in line and "75%" in line)
    for words in ("9.3", "19.0 ± 1.5", "9.0 ± 1.5", "-21.0"):
        assert words in pong
    sticky = [line for line in said.splitlines() if "pong" in line and "0.25" in line]
    assert [("-11.0 ± 1.5" in line, "-21.0 ± 1.5" in line, "0%" in line) for line in sticky] == [
        (True, True, True)
    ]
    row = next(row for row in content["rows"] if row["game"] == "pong")
    assert (row["ε"], row["robot"], row["share of the rise"]) == (0.001, "9.0 ± 1.5", "75%")


def test_a_game_without_random_games_has_no_share(
    lab: Lab, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lab.random = None
    played(tmp_path, "--game", "freeway")
    said = capsys.readouterr().out
    assert "50.0 ± 1.5" in said
    assert "%" not in said


def test_what_is_missing_is_trained_and_nothing_twice(lab: Lab, tmp_path: Path) -> None:
    lab.left = 1
    with pytest.raises(KeyboardInterrupt):
        played(tmp_path, "--game", "pong")
    lab.left = 10
    played(tmp_path, "--game", "pong")
    content = played(tmp_path, "--game", "pong", "seaquest", "seaquest")
    assert lab.trained == [(g, e) for g in ("pong", "seaquest") for e in ("ale", "robot")]
    assert len(content["runs"]) == 4
    with pytest.raises(InputError, match="holds no games of this budget"):
        played(tmp_path, "--learner=--play.sticky 0.25")
    lab.left = 1
    with pytest.raises(KeyboardInterrupt):
        played(tmp_path, "--game", "breakout")
    left = json.loads((tmp_path / "games.json").read_bytes())
    assert (len(left["runs"]), "rows" in left) == (5, False)  # none has the new run yet


def test_a_training_that_was_stopped_is_not_compared(lab: Lab, tmp_path: Path) -> None:
    lab.steps = 1_999
    with pytest.raises(InputError, match="stopped after 1,999 of 2,000 agent steps"):
        played(tmp_path, "--game", "pong")


def test_a_game_that_is_not_there_is_refused_before_any_training(lab: Lab, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no game 'zork'"):
        played(tmp_path, "--game", "pong", "zork")
    assert lab.trained == []


def test_figure(lab: Lab, tmp_path: Path) -> None:
    played(tmp_path, "--game", "pong", "seaquest", "freeway", "breakout", "asterix")
    figure = FIGURES["games"](Drawing((tmp_path / "games.json",)))
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert [axes.get_title("left") for axes in shown] == [
        *("pong", "seaquest", "freeway", "breakout", "asterix")
    ]
    pong = shown[0]
    assert [line.get_label() for line in pong.lines[:3]] == [
        "emulator alone",
        "robot",
        "random play",
    ]
    assert np.asarray(pong.lines[0].get_xdata()).tolist() == [0.8, 1.6]
    assert np.asarray(pong.lines[3].get_ydata()).tolist() == [9.3, 9.3]  # the human's
    assert len(shown[1].lines) == 3  # 20,182 is far from here
    (tmp_path / "games.json").write_text("{}")
    with pytest.raises(InputError, match="holds no games"):
        FIGURES["games"](Drawing((tmp_path / "games.json",)))
