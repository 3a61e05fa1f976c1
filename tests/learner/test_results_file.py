"""Files of results: only earlier results are replaced by new ones."""

import json
from pathlib import Path

import pytest

from benchmarks.report import BenchmarkOptions
from common.errors import InputError
from common.settings.config import RunConfig
from common.settings.stored_config import to_json
from learner.evaluation.options import EvaluationOptions
from tests.paths import ROOT

CARD = (ROOT / "policies" / "robot_pong.json").read_text()
SUMMARY = json.dumps({"run": "first", "machine": {"cores": 2}, "config": {}})
EVALUATION = (ROOT / "benchmarks" / "results" / "headline_robot_pong.json").read_text()
BENCHMARK = (ROOT / "benchmarks" / "results" / "chaos.json").read_text()


@pytest.mark.parametrize("options", [EvaluationOptions, BenchmarkOptions])
def test_only_earlier_results_are_replaced(options: type, tmp_path: Path) -> None:
    file = tmp_path / "file"
    for content in (to_json(RunConfig()), CARD, SUMMARY, "[1]", "epoch,phase\n", "\x89PNG"):
        file.write_text(content)
        with pytest.raises(InputError, match=r"file exists and holds no earlier results: name an"):
            options(json=file).check()
        assert file.read_text() == content
    for content in (EVALUATION, BENCHMARK, ""):
        file.write_text(content)
        options(json=file).check()
    options(json=tmp_path / "new").check()
