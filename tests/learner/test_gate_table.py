"""The gates' rows, read back with Python's own reader."""

import csv
from dataclasses import replace
from pathlib import Path

from learner.gate_table import COLUMNS, GateTable
from learner.gates import GATES, judge_gates
from learner.status import Status

STATUS = Status(
    run="r",
    preset="robot",
    env="robot",
    game="pong",
    device="cpu",
    phase="training",
    elapsed=61.25,
    agent_steps=1_000,
    warmup=500,
    epoch_steps=25_000,
    samples_per_insert_goal=8.0,
    capacity=200_000,
    gates=judge_gates(
        env="robot",
        valid_frame_share=0.25,
        pixel_deviation=0.5,
        max_q_deviation=None,
        squared_td_error=0.01,
        reward_variance=0.04,
        press_match_share=1.0,
        keys_can_follow=True,
        refused_chunks=0,
    ),
)


def read(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_each_gate_has_a_column() -> None:
    assert tuple(gate.name for gate in STATUS.gates) == GATES


def test_a_row_tells_values_and_which_are_red(tmp_path: Path) -> None:
    path = tmp_path / "gates.csv"
    table = GateTable(path)
    table.add(STATUS)
    table.add(replace(STATUS, agent_steps=2_000, gates=STATUS.gates[:1]))
    first, second = read(path)
    assert tuple(first) == COLUMNS
    assert first == {
        "seconds": "61.2",
        "agent_steps": "1000",
        "valid_frames": "0.25",
        "pixel_deviation": "0.5",
        "max-Q_deviation": "",
        "relative_TD_error": "0.25",
        "keys_as_commanded": "1",
        "refused_chunks": "0",
        "red": "valid frames; pixel deviation",
    }
    assert (second["agent_steps"], second["pixel_deviation"]) == ("2000", "")


def test_a_new_run_begins_anew(tmp_path: Path) -> None:
    path = tmp_path / "gates.csv"
    GateTable(path).add(STATUS)
    GateTable(path)
    assert read(path) == []


def test_resume_forgets_the_life_that_was_lost(tmp_path: Path) -> None:
    path = tmp_path / "gates.csv"
    table = GateTable(path, resumed_at=0)  # a run from before there was such a table
    for steps in (1_000, 2_000, 3_000):
        table.add(replace(STATUS, agent_steps=steps))
    with path.open("a") as file:
        file.write("70.0,15")  # torn
    GateTable(path, resumed_at=2_000).add(replace(STATUS, agent_steps=2_500))
    assert [row["agent_steps"] for row in read(path)] == ["1000", "2000", "2500"]
