"""`benchmarks.lab.transfer`: the same network on every rung."""

import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from benchmarks.lab import transfer
from benchmarks.lab.ladder import FLAGS, Rung
from benchmarks.lab.policy import evaluate
from benchmarks.report import run
from common.command_line.run_options import parse_run
from common.errors import InputError
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from learner.options import LearnerOptions
from tests.paths import ROOT

POLICY = ROOT / "policies" / "ale_pong.safetensors"


@cache
def played(flags: tuple[str, ...], trained: RunConfig) -> RunConfig:
    return parse_run(LearnerOptions, "learner", flags, lambda _: trained).config


@pytest.mark.parametrize("rung", list(FLAGS))
def test_a_rung_is_the_same_for_networks_of_all_rungs(rung: Rung) -> None:
    expected = played(tuple(FLAGS[rung]), PRESETS["fast"])
    for other in FLAGS:
        trained = played(tuple(FLAGS[other]), PRESETS["fast"])
        assert played(tuple(transfer.rung_flags(rung)), trained) == expected


def test_table_and_json(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def told(network: Path, games: int, epsilon: float, flags: Sequence[str]) -> dict[str, Any]:
        assert (network, games, epsilon) == (POLICY, 3, 0.001)
        late = flags[flags.index("--play.press-latency") + 1]
        score = {"mean": 7.0 - int(late), "deviation": 1.0, "least": 1.0, "most": 9.0}
        return {**score, "press_ms": {"p50": None}}

    results = tmp_path / "transfer.json"
    monkeypatch.setattr(transfer, "evaluate", told)
    arguments = [str(POLICY), "--games", "3", "--json", str(results)]
    run("lab.transfer", transfer.Options, transfer.measure, arguments)
    content = json.loads(results.read_text())
    assert [row["mean"] for row in content["rows"]] == [7.0, 5.0, 7.0, 7.0, 7.0]
    assert list(content["rungs"]) == list(FLAGS)
    assert content["rows"][3]["rung"] == "R4, keys pressed by the arms"
    assert "not trained anew; 3 games each" in " ".join(capsys.readouterr().out.split())


@pytest.mark.usefixtures("forks")
def test_games_that_cannot_be_played_are_told() -> None:
    with pytest.raises(InputError, match="ended with exit code 2"):
        evaluate(POLICY, 1, 0.001, ["--play.vector"])
    told = evaluate(POLICY, 1, 1.0, ["--play.max-game-frames", "400", "--play.random-starts", "0"])
    assert told["steps_of_games"] == [100]
