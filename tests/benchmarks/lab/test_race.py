"""`benchmarks.lab.race`: training, tests of kept weights, and when a score was first reached."""

import io
import json
import re
import shlex
import threading
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from actors.games import GamesOptions, games
from benchmarks import catch, report
from benchmarks.figures.plot import FIGURES
from benchmarks.lab import policy, race
from benchmarks.lab.policy import summary_of_all
from benchmarks.peer_dqn import Point
from benchmarks.report import run
from common.checked import MAX_NAME
from common.command_line.run_options import parse_run
from common.errors import InputError
from common.registry import ENVIRONMENTS
from common.run.epochs import EpochPhase, EpochTable
from common.run.folder import RunFolder
from common.settings.clock import ClockConfig
from common.settings.config import RunConfig
from common.settings.stored_config import to_json
from learner.evaluation import offline
from learner.evaluation.options import EvaluationOptions
from learner.figures.plot import Options as Drawing
from learner.options import LearnerOptions
from tests.end_to_end.conftest import Stage
from tests.epoch_rows import epoch_row
from tests.extending.whole_run import added, learned

MACHINE = {"cpu": "one", "cores": 2}
TRAINING = [
    (10.0, 400, 40, 19.0),
    (20.0, 800, 50, -3.0),
    (30.0, 1_200, 60, 9.3),
    (40.0, 1_600, 70, 0.0),
]
"""Seconds, agent steps, games, mean score: the first is of too few games."""
TESTS = {1: -20.0, 2: 4.0, 3: 18.0}


class Lab:
    """Trainings and evaluations that only write down what they were asked for."""

    def __init__(self) -> None:
        self.trained: list[str] = []
        self.played: list[tuple[str, int, float | None]] = []
        self.left = 10**6
        self.steps = 2_100
        self.epochs = tuple(TESTS)
        self.warm_up: EpochPhase = "random"

    def train(self, folder: RunFolder, steps: int, flags: Sequence[str]) -> dict[str, Any]:
        self.trained.append(folder.name)
        assert steps == 2_000
        options = parse_run(LearnerOptions, "learner", flags, lambda _: None)
        assert (options.keep_snapshots, options.evaluators, options.envs) == (True, 0, 4)
        assert options.config.protocol.epoch_steps == 500
        folder.path.mkdir(parents=True, exist_ok=True)
        folder.checkpoint.touch()
        folder.config_file.write_text(to_json(options.config))
        summary = {
            **{"preset": options.config.preset, "agent_steps": self.steps, "updates": 300},
            **{"wall_seconds": 42.0, "git_commit": "c0ffee", "git_dirty": False},
            **{"machine": MACHINE, "config": {"replay": {"learning_starts": 100}}},
        }
        folder.summary.write_text(json.dumps(summary))
        lines = ["seconds,agent_steps,games,train_reward", "1.0,0,0,"]
        lines += [",".join(map(str, row)) for row in TRAINING]
        folder.gates.write_text("\n".join(lines) + "\n")
        folder.epochs.unlink(missing_ok=True)
        table = EpochTable(folder.epochs)
        table.append(epoch_row([1.0], phase=self.warm_up))
        for epoch in self.epochs:
            times = {"total_train_steps": 500 * epoch, "total_time": 12.0 * epoch}
            table.append(epoch_row([1.0], epoch=epoch, phase="train", **times))
        return summary_of_all(folder, steps)

    def evaluate(
        self,
        network: Path,
        games: int,
        epsilon: float | None,
        flags: Sequence[str] = (),
        *,
        quiet: bool,
    ) -> dict[str, Any]:
        if not self.left:
            raise KeyboardInterrupt
        self.left -= 1
        self.played.append((network.name, games, epsilon))
        row: dict[str, Any] = {"epsilon": epsilon, "sticky": 0.0, "deviation": 1.0, "scores": []}
        if flags:
            assert (epsilon, list(flags)) == (None, ["--headline"])
            row["epsilon"] = 0.001
            return {"rows": [{**row, "mean": 20.0}, {**row, "sticky": 0.25, "mean": 5.0}]}
        return {**row, "mean": TESTS[int(network.stem[-4:])]}


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch) -> Lab:
    lab = Lab()
    for module in (policy, race):
        monkeypatch.setattr(module, "evaluate", lab.evaluate)
    monkeypatch.setattr(race, "train", lab.train)
    monkeypatch.setattr(report, "provenance", lambda: {"machine": MACHINE})
    return lab


def raced(folder: Path, *flags: str) -> dict[str, Any]:
    file = folder / "race.json"
    given = ["--env", "ale", "--steps", "2000", "--every", "500", "--learner=--envs 4"]
    arguments = [*given, "--runs", str(folder), "--json", str(file), *flags]
    run("lab.race", race.Options, race.measure, arguments)
    content: dict[str, Any] = json.loads(file.read_bytes())
    return content


def test_a_long_label_is_cut_in_the_name_of_a_run(lab: Lab, tmp_path: Path) -> None:
    label = "differences, and a rate that falls within the first 190,000 steps"
    content = raced(tmp_path, "--seeds", "1", "--seed", "4294967295", "--label", label)
    [name] = lab.trained
    cut = "race-ale-pong-differences-and-a-rate-th"
    assert re.fullmatch(rf"{cut}-[0-9a-f]{{8}}-seed-4294967295", name)
    assert len(name) == MAX_NAME
    assert content["title"] == f"{label} (ale)"


def test_a_warm_up_with_a_network_has_no_weights_to_test(lab: Lab, tmp_path: Path) -> None:
    lab.warm_up = "train"  # --exploration.start below 1
    content = raced(tmp_path, "--seeds", "1")
    assert [test["epoch"] for test in content["runs"][0]["tests"]] == list(TESTS)


def test_weights_that_were_trained_on_are_not_those_of_the_race(lab: Lab, tmp_path: Path) -> None:
    lab.left = len(TESTS)
    with pytest.raises(KeyboardInterrupt):
        raced(tmp_path, "--seeds", "1")
    lab.left = 10**6
    [name] = lab.trained
    summary = RunFolder(tmp_path, name).summary
    summary.write_text(summary.read_text().replace('"updates": 300', '"updates": 301'))
    with pytest.raises(InputError, match="was trained on, to 301 updates instead of 300"):
        raced(tmp_path, "--seeds", "1")


def test_a_peer_without_the_runs_settings_is_not_raced(lab: Lab, tmp_path: Path) -> None:
    options = race.Options(env="ale", runs=tmp_path)
    with pytest.raises(InputError, match="the peer's warm-up and ε, is gone"):
        race._train_peer(options, 1.0)


@pytest.mark.parametrize(
    "other",
    [{"learner": "--envs 2"}, {"steps": 3_000}, {"every": 501}, {"games": 4}, {"preset": "paper"}],
)
def test_races_of_other_settings_have_folders_of_their_own(other: dict[str, Any]) -> None:
    options = race.Options(env="ale", learner="--envs 4", steps=2_000, every=500, games=5)
    assert replace(options, **other).folder(1).name != options.folder(1).name


def test_a_race_tells_when_each_score_was_first_reached(
    lab: Lab, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = raced(tmp_path, "--seeds", "2", "--seed", "3", "--label", "Four envs")
    names = [
        re.fullmatch(r"race-ale-pong-four-envs-([0-9a-f]{8})-seed-([34])", name)
        for name in lab.trained
    ]
    assert [name and name[2] for name in names] == ["3", "4"]
    assert len({name and name[1] for name in names}) == 1
    assert lab.played[:3] == [(f"epoch-000{epoch}.safetensors", 5, 0.05) for epoch in (1, 2, 3)]
    assert lab.played[-1] == ("checkpoint.safetensors", 30, None)
    assert (content["title"], content["games"]) == ("Four envs (ale)", 5)
    first, second = content["runs"]
    assert (first["seed"], second["seed"]) == (3, 4)
    assert first["training"] == {
        "0": {"seconds": 30.0, "agent_steps": 1_200},
        "9.3": {"seconds": 30.0, "agent_steps": 1_200},
        "18": None,
    }
    assert first["test"] == {  # the warm-up's 100 steps are agent steps too
        "0": {"seconds": 24.0, "agent_steps": 1_100},
        "9.3": {"seconds": 36.0, "agent_steps": 1_600},
        "18": {"seconds": 36.0, "agent_steps": 1_600},
    }
    assert (first["steps_per_second"], first["updates_per_second"]) == (2_100 / 42, 300 / 42)
    assert (first["machine"], first["git_commit"]) == (MACHINE, "c0ffee")
    assert first["command"].startswith("python -m learner --local --steps 2000 --env ale")
    said = " ".join(capsys.readouterr().out.split())
    for words in ("2 of 2, about 0 min left: seed 4", "0.6 min, 1,600", "20.0 ± 1.0"):
        assert words in said


def test_a_run_that_ends_within_its_first_epoch_has_no_tests(
    lab: Lab, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lab.epochs = ()
    (only,) = raced(tmp_path, "--seeds", "1")["runs"]
    assert (only["tests"], only["test"]) == ([], {"0": None, "9.3": None, "18": None})
    assert "20.0 ± 1.0" in capsys.readouterr().out  # of its last weights


def test_an_interrupted_race_goes_on(lab: Lab, tmp_path: Path) -> None:
    lab.left = 2
    with pytest.raises(KeyboardInterrupt):
        raced(tmp_path, "--seeds", "1")
    lab.left = 2 + 4  # the rest of the first, and all of the second
    content = raced(tmp_path, "--seeds", "2")
    assert len(lab.trained) == len(set(lab.trained)) == 2
    assert len(lab.played) == 2 * 4
    assert [each["mean"] for each in content["runs"][1]["tests"]] == list(TESTS.values())
    before = (tmp_path / "race.json").read_bytes()
    with pytest.raises(InputError, match="holds no race of this budget"):
        raced(tmp_path, "--games", "6")
    assert (tmp_path / "race.json").read_bytes() == before


def test_a_training_that_was_stopped_is_resumed(lab: Lab, tmp_path: Path) -> None:
    lab.steps = 1_999
    with pytest.raises(InputError, match="stopped after 1,999 of 2,000 agent steps"):
        raced(tmp_path, "--seeds", "1")
    lab.steps = 2_000
    (seed,) = raced(tmp_path, "--seeds", "1")["runs"]
    assert (len(lab.trained), seed["interrupted"]) == (2, True)


def test_a_peer_runs_as_long_beside_it(
    lab: Lab, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def curve(config: object, seconds: float, recent: int) -> list[Point]:
        assert (seconds, recent) == (42.0, 50)
        return [(10.0, 900, -20.0), (40.0, 4_000, 1.0)]

    monkeypatch.setattr(race, "peer_curve", curve)
    monkeypatch.setattr(race, "is_installed", lambda package: package == "stable_baselines3")
    peer = raced(tmp_path, "--seeds", "1", "--peer")["peer"]
    assert peer["training"]["0"] == {"seconds": 40.0, "agent_steps": 4_000}
    axes = FIGURES["race"](Drawing((tmp_path / "race.json",))).axes[0]
    lines = {line.get_label(): np.asarray(line.get_xydata()).tolist() for line in axes.get_lines()}
    ours = "preset fast --envs 4 (ale), pong, tests of 5 games at ε = 0.05"
    assert lines[ours] == [[0.2, -20.0], [0.4, 4.0], [0.6, 18.0]]
    assert lines["stable-baselines3 DQN, training games"] == [[10 / 60, -20.0], [40 / 60, 1.0]]
    assert [text.get_text() for text in axes.texts] == ["0", "9.3 (human)", "18"]


def test_a_peer_that_is_not_there_is_told(
    lab: Lab,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(race, "is_installed", lambda package: False)
    assert "peer" not in raced(tmp_path, "--seeds", "1", "--peer")
    assert "stable-baselines3 DQN is not installed" in capsys.readouterr().out
    with pytest.raises(InputError, match="--peer plays Pong by the emulator alone"):
        raced(tmp_path, "--game", "breakout", "--peer")


QUICK = " ".join(
    [
        "--stream.chunk-steps 16 --stream.window 2 --protocol.held-out-states 16",
        "--replay.learning-starts 64 --replay.capacity 5000 --replay.ratio-tolerance 64",
        "--learning.batch-size 4 --learning.train-period 8 --learning.network nips",
    ]
)


def test_a_whole_race_in_one_process(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Trains, keeps weights and plays games of Catch; only the processes are not there."""

    def parsed(*flags: str) -> LearnerOptions:
        return parse_run(LearnerOptions, "learner", flags, lambda _: None)

    def train(folder: RunFolder, steps: int, flags: Sequence[str]) -> dict[str, Any]:
        given = parsed(*flags)
        summary, _ = learned(
            given.config, tmp_path, steps, run=folder.name, keep_snapshots=given.keep_snapshots
        )
        return summary

    def play(
        network: Path,
        given: EvaluationOptions,
        epsilon: float,
        config: RunConfig,
        flags: Sequence[str],
        stop: threading.Event,
    ) -> Iterator[dict[str, Any]]:
        asked = GamesOptions(network, "", 800, epsilon, given.games)
        yield from ({"process": 0, **game} for game in games(config, asked, stop))

    def evaluate(
        network: Path, games: int, epsilon: float | None, flags: Sequence[str] = (), *, quiet: bool
    ) -> Any:
        given = EvaluationOptions(bool(flags), games, epsilon=epsilon)
        config = parsed("--env", "catch", *shlex.split(QUICK)).config
        nobody = Console(file=io.StringIO())
        return offline.evaluate(network, given, config, ClockConfig(), threading.Event(), nobody)

    monkeypatch.setattr(race, "train", train)
    monkeypatch.setattr(offline, "play", play)
    for module in (policy, race):
        monkeypatch.setattr(module, "evaluate", evaluate)
    file = tmp_path / "race.json"
    given = ["--env", "catch", "--steps", "400", "--every", "150", "--games", "5", "--seeds", "1"]
    more = ["--preset", "fast", f"--learner={QUICK}", "--runs", str(tmp_path), "--json", str(file)]
    with added(ENVIRONMENTS, catch.CATCH):
        run("lab.race", race.Options, race.measure, [*given, *more])
    _check(json.loads(file.read_bytes()))
    assert FIGURES["race"](Drawing((file,))).axes[0].get_ylabel() == "mean score of a game"


@pytest.mark.slow
def test_a_race_of_real_processes(stage: Stage) -> None:
    catch.install(stage.folder)
    given = ["--env", "catch", "--steps", "400", "--every", "150", "--games", "5", "--seeds", "1"]
    file = stage.folder / "race.json"
    more = [f"--learner=--threads 1 {QUICK}", "--json", str(file)]
    stage.start("-m", "benchmarks.lab.race", *given, *more).ends()
    _check(json.loads(file.read_bytes()))


def _check(content: dict[str, Any]) -> None:
    """What a race of Catch has to tell."""
    (seed,) = content["runs"]
    tests = seed["tests"]
    assert content["epsilon"] == 0.05
    assert [test["epoch"] for test in tests] == list(range(1, len(tests) + 1))
    assert len(tests) >= 2
    assert all(len(test["scores"]) == 5 for test in tests)
    times = [test["seconds"] for test in tests]
    assert times == sorted(set(times))
    assert times[-1] <= seed["wall_seconds"]
    steps = [test["agent_steps"] for test in tests]
    assert steps == sorted(set(steps))
    assert steps[0] >= 214
    assert steps[-1] <= seed["agent_steps"]
    assert seed["updates"] > 0
    assert set(seed["training"]) == set(seed["test"]) == {"0", "9.3", "18"}
    assert seed["test"]["9.3"] is None
    measures = [(row["epsilon"], row["sticky"]) for row in seed["headline"]]
    assert measures == [(0.001, 0), (0.05, 0)]  # Catch has no console, so no sticky actions
    assert all(-1 <= row["mean"] <= 1 and row["games"] == 30 for row in seed["headline"])
