"""`benchmarks.lab.adaptation`: before, training, after."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks.lab import adaptation
from benchmarks.report import run
from common.command_line.run_options import parse_run
from common.errors import InputError
from common.run.epochs import EpochTable
from common.run.folder import RunFolder
from common.run.origin import origin_of
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from learner.options import LearnerOptions
from tests.end_to_end.conftest import SMALL
from tests.epoch_rows import epoch_row
from tests.paths import ROOT

POLICIES = ROOT / "policies"


def parsed(flags: Sequence[str]) -> RunConfig:
    return parse_run(LearnerOptions, "learner", flags, lambda _: None).config


@pytest.mark.parametrize("name", ["ale_pong", "robot_pong"])
def test_a_training_has_the_world_and_the_network_of_the_policy(name: str) -> None:
    network = POLICIES / f"{name}.safetensors"
    trained = origin_of(network)
    assert trained is not None
    initial = ("--initial", str(network))
    config = parsed([*adaptation.training_flags(trained, 20_000), *initial])
    assert (config.env, config.game, config.play) == (trained.env, trained.game, trained.play)
    assert config.camera == trained.camera
    assert config.learning.network == trained.learning.network
    assert config.samples_per_insert == 16
    assert config.learning.annealing_steps == 20_000
    assert config.protocol.epoch_steps == 2_000


def test_settings_that_are_unlike_the_presets_are_flags() -> None:
    fast = PRESETS["fast"]
    trained = replace(
        fast,
        play=replace(fast.play, vector=True, minimal_actions=False, press_latency=2),
        learning=replace(fast.learning, n_step=9),
    )
    config = parsed(adaptation.training_flags(trained, 5_000))
    assert config.play == trained.play
    assert config.learning.n_step == fast.learning.n_step  # no part of the world


class Lab:
    """Evaluations and a training that only write down what they were asked for."""

    def __init__(self, scores: Sequence[float]) -> None:
        self.scores = list(scores)
        self.played: list[tuple[str, tuple[str, ...]]] = []
        self.trained: list[list[str]] = []

    def evaluate(
        self, network: Path, games: int, epsilon: float, flags: Sequence[str] = ()
    ) -> dict[str, Any]:
        self.played.append((network.name, tuple(flags)))
        mean = self.scores.pop(0)
        return {"mean": mean, "deviation": 1.0, "iqm": mean}

    def train(self, folder: RunFolder, steps: int, flags: Sequence[str]) -> dict[str, Any]:
        self.trained.append([f"{steps}", *flags])
        folder.path.mkdir(parents=True, exist_ok=True)
        table = EpochTable(folder.epochs)
        for epoch, score in enumerate((-19.0, 12.0, 18.5, 20.0), 1):
            table.append(
                replace(
                    epoch_row(),
                    epoch=epoch,
                    phase="train",
                    total_train_steps=epoch * 500,
                    average_reward=score,
                    total_time=120.0 * epoch,
                )
            )
        return {}


def adapt(lab: Lab, monkeypatch: pytest.MonkeyPatch, runs: Path, *more: str) -> dict[str, Any]:
    monkeypatch.setattr(adaptation, "evaluate", lab.evaluate)
    monkeypatch.setattr(adaptation, "train", lab.train)
    file = runs / "adaptation.json"
    policy = str(POLICIES / "ale_pong.safetensors")
    arguments = [policy, "--to=--play.press-latency 4", "--steps", "2000", "--runs", str(runs)]
    main = (adaptation.Options, adaptation.measure, [*arguments, "--json", str(file), *more])
    run("lab.adaptation", *main)
    content: dict[str, Any] = json.loads(file.read_bytes())
    return content


def test_report(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lab = Lab([20.5, -20.0, 19.0])
    content = adapt(lab, monkeypatch, tmp_path, "--learner=--threads 1")
    to = ("--play.press-latency", "4")
    assert lab.played == [
        ("ale_pong.safetensors", ()),
        ("ale_pong.safetensors", to),
        ("checkpoint.safetensors", to),
    ]
    (flags,) = lab.trained
    assert flags[0] == "2000"
    assert flags[-2:] == ["--initial", str(POLICIES / "ale_pong.safetensors")]
    assert "--play.press-latency" in flags
    assert content["flags"].split() == flags[1:-2]  # those of --learner too
    assert [content[name]["mean"] for name in ("own", "before", "after")] == [20.5, -20.0, 19.0]
    assert content["steps_to_own"] == 1_500  # the first at 18.5 or more
    assert [point["minutes"] for point in content["curve"]] == [2.0, 4.0, 6.0, 8.0]
    assert "from 1,500 training steps and 6 minutes on it was within" in capsys.readouterr().out


def test_a_policy_that_never_plays_as_before_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = adapt(Lab([30.0, -20.0, 19.0]), monkeypatch, tmp_path)
    assert content["steps_to_own"] is None
    assert "did not come to stay within two points" in capsys.readouterr().out


def test_a_good_epoch_is_nothing_if_the_last_weights_do_not_play_so(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert adapt(Lab([20.5, -20.0, 18.4]), monkeypatch, tmp_path)["steps_to_own"] is None


def test_settings_with_which_nothing_can_train_are_refused_before_any_game(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Those of the network's training go on, with their ranges."""
    lab = Lab([])
    network = str(POLICIES / "robot_pong_robust.safetensors")
    arguments = [network, "--to=--play.actuation-latency 30", "--runs", str(tmp_path)]
    monkeypatch.setattr(adaptation, "evaluate", lab.evaluate)
    with pytest.raises(InputError, match=r"--play\.actuation-latency is 42: choose at most 36"):
        run("lab.adaptation", adaptation.Options, adaptation.measure, arguments)
    assert not lab.played


def test_a_network_of_unknown_settings_is_refused(tmp_path: Path) -> None:
    network = tmp_path / "alone.safetensors"
    network.write_bytes((POLICIES / "ale_pong.safetensors").read_bytes())
    with pytest.raises(InputError, match=r"settings of the training of .* are unknown"):
        adaptation.measure(adaptation.Options(network=network, to="--env robot"))


@pytest.mark.slow
def test_a_policy_is_trained_on_for_real(tmp_path: Path) -> None:
    small = " ".join(flag for flag in SMALL if "network" not in flag)
    options = adaptation.Options(
        network=POLICIES / "ale_pong.safetensors",
        to="--play.press-latency 1 --play.max-game-frames 400",
        steps=900,
        games=1,
        learner=f"{small} --threads 1",
        runs=tmp_path,
    )
    content = adaptation.measure(options).content
    assert content["after"]["games"] == 1
    assert len(content["curve"]) >= 1
