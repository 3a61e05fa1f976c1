"""`benchmarks.lab.hand_latency`: the published policy under keys that come late."""

import csv
from pathlib import Path
from typing import Any

import pytest

from benchmarks import report
from benchmarks.lab import hand_latency
from benchmarks.lab.hand_latency import COLUMNS, Options, hand_flags, measure, run_or_policy
from common.errors import InputError
from tests.paths import ROOT

ALE = ROOT / "policies" / "ale_pong.safetensors"
ROBOT = ALE.with_name("robot_pong.safetensors")


def run(*arguments: str) -> None:
    report.run("lab.hand_latency", Options, measure, arguments)


@pytest.mark.usefixtures("forks")
def test_a_row_for_each_network_and_lateness(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    output = tmp_path / "hand_latency.csv"
    # Wholly random games, which are short.
    random = ["--games", "1", "--epsilon", "1"]
    run(str(ALE), *random, "--press", "0", "60", "-o", str(output))
    assert "1,000.0" in capsys.readouterr().out
    with output.open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["network"], row["press"]) for row in rows] == [
        ("ale_pong", "0"),
        ("ale_pong", "60"),
    ]
    assert [float(row["late_ms"]) for row in rows] == [0.0, 1000.0]
    # The same random commands play other games by late keys.
    assert rows[0]["seed"] == rows[1]["seed"]
    assert all(-21 <= float(row["mean"]) < 0 for row in rows)


def test_one_that_is_stopped_leaves_the_rows_that_it_has(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def play(network: Path, press: int, options: Options) -> dict[str, Any]:
        if press == options.press[len(rows)]:
            raise KeyboardInterrupt
        return dict.fromkeys(COLUMNS, press)

    output = tmp_path / "hand_latency.csv"
    monkeypatch.setattr(hand_latency, "play", play)
    for rows in ([], ["5"]):
        with pytest.raises(KeyboardInterrupt):
            run(str(ALE), "--press", "5", "7", "-o", str(output))
        told = output.read_text().splitlines() if output.exists() else []
        assert [row["press"] for row in csv.DictReader(told)] == rows
        assert output.exists() == bool(rows)


def test_a_robots_keys_are_those_of_a_modelled_hand() -> None:
    late = ["--play.press-latency", "3"]
    assert hand_flags(ALE, 3) == late
    assert hand_flags(ROBOT, 3) == [*late, "--play.hand", "model"]


def test_networks_in_runs_have_the_runs_name(tmp_path: Path) -> None:
    network = tmp_path / "run" / "checkpoint.safetensors"
    assert run_or_policy(network) == "checkpoint"
    network.parent.mkdir()
    network.with_name("config.json").touch()
    for file in (network, network.parent / "snapshots" / "best.safetensors"):
        assert run_or_policy(file) == "run"
    assert run_or_policy(ALE) == "ale_pong"


def test_what_cannot_be_played_is_refused(tmp_path: Path) -> None:
    for arguments, words in (
        ([], "--networks is .*: choose at least 1 of them"),
        ([str(ALE), "--press", "61"], r"--press\.0 is 61: choose at most 60"),
        ([str(ALE), "-o", str(tmp_path)], "is a folder: name a file in it"),
    ):
        with pytest.raises(InputError, match=words):
            run(*arguments)
    with pytest.raises(InputError, match=r"settings of the training of .* are unknown"):
        hand_flags(tmp_path / "weights.safetensors", 0)
