"""How long an update takes, by all kinds of arithmetic that are here."""

import torch

from benchmarks.learner_updates import Options, measure
from common.native.kernel import instruction_sets
from tests.native import NEEDS_NATIVE


@NEEDS_NATIVE
def test_every_table_has_its_rows_and_numbers() -> None:
    before = torch.get_num_threads()
    report = measure(Options(batch_size=2, rounds=1, turn=1, compared=2, seeds=2))
    torch.set_num_threads(before)
    native = [f"native, {each}" for each in instruction_sets()]
    precisions = ["float32", "bfloat16", *native]
    tables = report.content
    assert {row["precision"] for row in tables["rows"]} == set(precisions)
    assert [row["precision"] for row in tables["precisions"]] == precisions
    float32 = tables["precisions"][0]["mean loss"]
    for row in tables["precisions"]:
        assert 0.9 < row["mean loss"] / float32 < 1.1
    assert all(row["p50 ms"] > 0 for row in tables["rows"])
    assert [row["part"] for row in tables["native"]][-1] == "backward"
