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
from common.run.folder import RunFolder
from common.run.origin import origin_of
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from learner.options import LearnerOptions
from tests.end_to_end.conftest import SMALL
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
    """Evaluations and trainings that only write down what they were asked for."""

    def __init__(self, scores: Sequence[float]) -> None:
        self.scores = list(scores)
        self.played: list[tuple[str, tuple[str, ...]]] = []
        self.trained: list[list[str]] = []

    def evaluate(
        self, network: Path, games: int, epsilon: float, flags: Sequence[str] = ()
    ) -> dict[str, Any]:
        assert network.exists()
        self.played.append((network.name, tuple(flags)))
        mean = self.scores.pop(0)
        return {"mean": mean, "deviation": 1.0, "iqm": mean, "steps": 7_000}

    def train(self, folder: RunFolder, steps: int, flags: Sequence[str]) -> dict[str, Any]:
        self.trained.append([f"{steps}", *flags])
        folder.path.mkdir(parents=True, exist_ok=True)
        folder.checkpoint.write_text(f"{steps}")
        return {"agent_steps": steps + 1, "wall_seconds": 0.12 * steps, "updates": 3}


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
    lab = Lab([-20.0, 20.5, 19.0, 12.0, 18.5, 18.6])
    content = adapt(lab, monkeypatch, tmp_path, "--learner=--threads 1")
    to = ("--play.press-latency", "4")
    tests = [f"after-{steps}.safetensors" for steps in (500, 1_000, 1_500, 2_000)]
    assert lab.played == [
        ("ale_pong.safetensors", to),  # first, since it cannot play in every world
        ("ale_pong.safetensors", ()),
        *((name, to) for name in tests),
    ]
    assert [steps for steps, *_ in lab.trained] == ["500", "1000", "1500", "2000"]
    for _, *flags in lab.trained:
        assert flags[-2:] == ["--initial", str(POLICIES / "ale_pong.safetensors")]
        assert "--play.press-latency" in flags
        assert content["flags"].split() == flags[:-2]  # those of --learner too
    assert content["own"]["mean"] == 20.5
    assert [each["mean"] for each in content["curve"]] == [-20.0, 19.0, 12.0, 18.5, 18.6]
    assert [each["trained_steps"] for each in content["curve"]] == [0, 501, 1_001, 1_501, 2_001]
    assert [each["minutes"] for each in content["curve"]] == [0, 1, 2, 3, 4]
    assert content["steps_to_own"] == 1_501  # from there on all have 18.5 or more
    assert {each["steps"] for each in content["curve"]} == {7_000}  # of the games
    said = capsys.readouterr().out
    assert "from 1,501 agent steps and 3.0 minutes of training on it was" in said
    cells = [[cell.strip() for cell in line.split("│")[1:-1]] for line in said.splitlines()]
    assert ["its own", "–", "20.5", "1", "20.5"] in cells
    assert ["the other, 501 agent steps", "1", "19.0", "1", "19.0"] in cells
    kept = tmp_path / "adaptation" / "after-1000.safetensors"
    assert kept.read_text() == "1000"


def test_what_was_trained_is_not_trained_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    lab = Lab([-20.0, 20.5, 19.0])
    with pytest.raises(IndexError):  # as if interrupted in the second test
        adapt(lab, monkeypatch, tmp_path)
    again = Lab([-20.0, 20.5, 19.0, 19.0, 19.0, 19.0])
    content = adapt(again, monkeypatch, tmp_path)
    assert [steps for steps, *_ in lab.trained] == ["500", "1000"]
    assert [steps for steps, *_ in again.trained] == ["1500", "2000"]
    assert content["steps_to_own"] == 501
    assert content["curve"][1]["minutes"] == 1


@pytest.mark.parametrize("other", ["network", "world"])
def test_a_training_of_another_policy_or_world_is_not_taken_for_this_one(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, other: str
) -> None:
    adapt(Lab([20.0] * 6), monkeypatch, tmp_path)
    policy, to = POLICIES / "ale_pong.safetensors", "--play.press-latency 4"
    if other == "network":
        policy = POLICIES / "ale_pong_sticky.safetensors"
    else:
        to = "--play.press-latency 3"
    arguments = [f"{policy}", f"--to={to}", "--steps", "2000", "--runs", str(tmp_path)]
    monkeypatch.setattr(adaptation, "evaluate", Lab([]).evaluate)  # nothing is played
    with pytest.raises(InputError, match="or of another adaptation: name another with --run"):
        run("lab.adaptation", adaptation.Options, adaptation.measure, arguments)


@pytest.mark.parametrize("content", ['{"flags": [', "[]", "{}"])
def test_a_damaged_note_of_a_test_is_refused_before_any_game(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, content: str
) -> None:
    adapt(Lab([20.0] * 6), monkeypatch, tmp_path)
    (tmp_path / "adaptation" / "after-1500.json").write_text(content)
    with pytest.raises(InputError, match=r"after-1500\.json is damaged or of another adaptation"):
        adapt(Lab([]), monkeypatch, tmp_path)


@pytest.mark.parametrize(
    ("to", "learner"), [("--seed 4", ""), ("", "--steps=9"), ("'", ""), ("", '"')]
)
def test_flags_of_its_own_and_open_quotes_are_refused(to: str, learner: str) -> None:
    network = POLICIES / "ale_pong.safetensors"
    options = adaptation.Options(network=network, to=to, learner=learner)
    with pytest.raises(InputError, match=r"which the experiment itself gives|No closing quotation"):
        options.check()


def test_more_tests_than_steps_are_refused() -> None:
    options = adaptation.Options(network=POLICIES / "ale_pong.safetensors", to="", steps=3, tests=4)
    with pytest.raises(InputError, match="--tests 4 is more than --steps: choose fewer"):
        options.check()


def test_a_policy_that_never_plays_as_before_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = adapt(Lab([-20.0, 20.5, 20.0, 20.0, 20.0, 18.4]), monkeypatch, tmp_path)
    assert content["steps_to_own"] is None
    assert "after all of them it was not within 2 points" in capsys.readouterr().out


def test_a_policy_that_need_not_learn_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    content = adapt(Lab([18.5, 20.5, 19.0]), monkeypatch, tmp_path, "--tests", "1")
    assert content["steps_to_own"] == 0


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
        tests=2,
        games=1,
        learner=f"{small} --threads 1",
        runs=tmp_path,
    )
    curve = adaptation.measure(options).content["curve"]
    assert [each["games"] for each in curve] == [1, 1, 1]
    start, half, end = (each["trained_steps"] for each in curve)
    assert start == 0 < 450 <= half < 900 <= end
    assert 0 < curve[1]["minutes"] < curve[2]["minutes"]
