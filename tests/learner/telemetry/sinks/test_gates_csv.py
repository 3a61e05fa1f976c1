"""The gates' rows, read back with Python's own reader."""

import csv
import math
from dataclasses import replace
from pathlib import Path

from common.press_latency import Delay
from common.run.config import PlayConfig
from learner.telemetry.health_checks import GATES, judge_gates
from learner.telemetry.sinks.gates_csv import COLUMNS, GateTable
from learner.telemetry.status import Status

PRESS = Delay(1_224, 50.0, 200 / 3, 200 / 3)
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
        press=PRESS,
        play=PlayConfig(),
        refused_chunks=0,
    ),
    press=PRESS,
    release=Delay(1_300, 50 / 3, math.inf, 100.0),
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
        "press_p99_ms": "66.6667",
        "refused_chunks": "0",
        "press_p50_ms": "50",
        "release_p50_ms": "16.6667",
        "release_p99_ms": "inf",
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


def test_a_table_with_fewer_columns_is_carried_over(tmp_path: Path) -> None:
    path = tmp_path / "gates.csv"
    path.write_text(
        "seconds,agent_steps,valid_frames,refused_chunks,red\n"
        "1.0,500,0.5,0,valid frames\n"
        "2.0,1000,1\n"
        "3.0,1500,1,0,\n"
        "4.0,2000,1,0,\n"
    )
    GateTable(path, resumed_at=1_500).add(replace(STATUS, agent_steps=1_600))
    old, newer, new = read(path)
    empty = dict.fromkeys(COLUMNS, "")
    assert old == empty | {
        "seconds": "1.0",
        "agent_steps": "500",
        "valid_frames": "0.5",
        "refused_chunks": "0",
        "red": "valid frames",
    }
    assert (newer["agent_steps"], newer["valid_frames"], newer["red"]) == ("1500", "1", "")
    assert (new["agent_steps"], new["press_p50_ms"]) == ("1600", "50")


def test_what_is_no_table_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "gates.csv"
    for noise in ("", "\n", "noise", "a,b\n1,2\n", "agent_steps\n-1\n"):
        path.write_text(noise)
        GateTable(path, resumed_at=1_000).add(STATUS)
        assert [row["agent_steps"] for row in read(path)] == ["1000"]
