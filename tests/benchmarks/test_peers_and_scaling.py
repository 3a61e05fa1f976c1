"""`benchmarks.peers` and `benchmarks.scaling`: who is compared with whom, and how often."""

import importlib.util
import json
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks import peer_update, peers, scaling
from benchmarks.child import Helper
from benchmarks.epochs_per_day import Paces
from benchmarks.local_run import LocalRun, Pace, Setting
from benchmarks.report import run
from common.command_line.parser import check_bounds
from common.errors import InputError


def test_medians_of_turns_after_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    told = {"ours": iter([99.0, 4.0, 6.0, 5.0]), "slow": iter([99.0, 1.0, 1.0, 7.0])}
    order: list[str] = []

    def rate(name: str, seconds: float) -> float:
        order.append(name)
        return next(told[name]) / seconds

    monkeypatch.setattr(peers, "_SHORT_TURNS", 3)
    monkeypatch.setattr(peers, "_SHORT_TURN", 0.5)
    contenders = {name: partial(rate, name) for name in told}
    (found,) = peers.in_short_turns("work", contenders)
    assert (found["peer"], found["peer/s"], found["ours/s"]) == ("slow", 2, 10)
    assert order == ["ours", "slow"] * 4


def replay_elsewhere(folder: Path, *, prioritised: bool) -> Helper:
    settings = {"who": "ours", "size": 1_000, "folder": str(folder), "prioritised": prioritised}
    return Helper("ours", "benchmarks.peer_replays", **settings)


@pytest.mark.usefixtures("forks")
def test_our_replay_in_a_process_of_its_own(tmp_path: Path) -> None:
    with replay_elsewhere(tmp_path, prioritised=True) as ours:
        for work, units in (("insert", 64), ("draw", 1)):
            for seconds in (0.02, 0.0):
                began = time.monotonic()
                rate = ours.ask(work, seconds)
                # However slow the machine: at least one call, in no more time than has passed.
                assert rate * (time.monotonic() - began) >= units


@pytest.mark.usefixtures("forks")
def test_a_replay_that_cannot_be_had_says_so(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with (
        replay_elsewhere(tmp_path / "file" / "below", prioritised=False) as ours,
        pytest.raises(InputError, match="ours failed"),
    ):
        ours.ask("draw", 0.1)


def test_each_peer_beside_ours() -> None:
    found = peers.against_ours("draw", {"a": [10.0], "ours": [30.0], "b": [60.0]})
    assert [(each["peer"], each["peer/s"], each["ratio"]) for each in found] == [
        ("a", 10.0, 3.0),
        ("b", 60.0, 0.5),
    ]


def test_both_of_our_minibatches_stand_beside_the_peer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch, "get_num_threads", lambda: 2)
    monkeypatch.setattr(torch, "set_num_threads", lambda count: None)
    monkeypatch.setattr(peers, "peer_dqn", lambda: lambda seconds, threads: 50.0 * threads)
    rates = {"paper": 300.0, "fast": 500.0}
    monkeypatch.setattr(peers, "our_training", lambda preset, seconds: rates[preset])
    found = peers.compare_training(peers.Options())
    assert [(each["work"], each["peer"], each["ratio"]) for each in found] == [
        ("training steps, Pong, minibatches of 32", "stable-baselines3 DQN, 1 thread", 6.0),
        ("training steps, Pong, minibatches of 32", "stable-baselines3 DQN, 2 threads", 3.0),
        ("training steps, Pong, ours of 128", "stable-baselines3 DQN, 1 thread", 10.0),
        ("training steps, Pong, ours of 128", "stable-baselines3 DQN, 2 threads", 5.0),
    ]


def test_the_preset_of_a_local_run_can_be_chosen() -> None:
    settings = Setting(), Setting(env="robot"), Setting(preset="fast")
    presets = [each.flags()[1] for each in settings]
    assert presets == ["paper", "robot", "fast"]


def test_what_is_not_installed_is_passed_over(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    results = tmp_path / "peers.json"
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(
        peers,
        "compare_updates",
        lambda: peers.against_ours("updates", {"PyTorch": [20.0], "ours": [50.0]}),
    )
    run("peers", peers.Options, peers.measure, ["--json", str(results)])
    printed = capsys.readouterr().out
    assert "stable-baselines3 is not installed" in printed
    assert "cpprb is not installed" in printed
    found = json.loads(results.read_text())
    assert [(each["work"], each["ratio"]) for each in found["rows"]] == [("updates", 2.5)]
    assert len(found["skipped"]) == 3


def test_both_updates_update() -> None:
    for make in (peer_update.eager, peer_update.ours):
        action = make()
        losses = [action() for _ in range(8)]
        assert np.isfinite(losses).all()
        assert losses[-1] < losses[0]  # on the same batch again and again


def pace(train: float, test: float) -> Pace:
    return Pace(10.0, train, train / 4, test, 8.0, 20.0, 40.0, None, dict.fromkeys("lae", 0.2))


def test_a_row_for_each_number_of_actors(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def measured(setting: Setting, seconds: float) -> Paces:
        return Paces(pace(100.0 * setting.actors, 0.0), pace(80.0 * setting.actors, 500.0), 900.0)

    results = tmp_path / "scaling.json"
    monkeypatch.setattr(scaling, "paces_of", measured)
    flags = ["--numbers", "1", "3", "--json", str(results)]
    run("scaling", scaling.Options, scaling.measure, flags)
    found = json.loads(results.read_text())
    assert [each["train_steps_per_second"] for each in found["scaling"]] == [100.0, 300.0]
    assert [each["actors"] for each in found["scaling"]] == [1, 3]
    assert [row["train/s"] for row in found["rows"]] == [100.0, 300.0]
    assert "3: 300.0 steps/s" in capsys.readouterr().out


def test_settings_that_cannot_work() -> None:
    with pytest.raises(InputError, match="numbers"):
        check_bounds(scaling.Options(numbers=(0,)))
    with pytest.raises(InputError, match="only"):
        check_bounds(peers.Options(only=()))


@pytest.mark.slow
def test_a_real_run_watched() -> None:
    with LocalRun(Setting(learner="--threads 1"), epoch_steps=256) as run:
        run.settle()
        run.await_tests()
        found = run.measure(3.0)
    assert found.train_steps_per_second > 0
    assert found.test_steps_per_second > 0
    ratio = found.updates_per_second * 32 / found.train_steps_per_second
    assert found.samples_per_insert == pytest.approx(ratio)
    assert all(share > 0 for share in found.cpu_share.values())
    assert sum(found.cpu_share.values()) <= 1.05
    assert found.staleness_p50 <= found.staleness_p95


@pytest.mark.slow
def test_tests_alone_are_watched_when_training_is_over() -> None:
    with LocalRun(Setting(learner="--threads 1"), epoch_steps=256, steps=1_000) as run:
        run.await_tests()
        run.await_rest()
        assert run.test_rate(3.0) > 0


@pytest.mark.usefixtures("forks")
def test_a_learner_that_cannot_start_says_why() -> None:
    setting = Setting(learner="--replay.ratio-tolerance 1")
    with pytest.raises(InputError, match="ratio-tolerance"), LocalRun(setting):
        pass
