"""The health checks' rows, read back with Python's own reader."""

import csv
import math
from pathlib import Path

from common.metrics import Value
from common.settings.presets import PRESETS
from learner.telemetry.health_checks import judge
from learner.telemetry.sinks.gates_csv import GatesCsvSink
from tests.learner.telemetry.snapshots import changed, snapshot

VALUES: dict[str, Value] = {
    "run/seconds": 61.25,
    "run/agent_steps": 1_000,
    "play/train_reward": -20.5,
    "play/games": 7,
    "play/valid_frame_share": 0.25,
    "play/following_frame_share": 0.75,
    "learning/pixel_deviation": 0.5,
    "learning/held_out_std": None,
    "learning/recent_max_q_std": 0.125,
    "learning/relative_td_error": 0.25,
    "play/press_match_share": 1.0,
    "stream/chunks_refused": 0,
    "hands/press_p50": 50.0,
    "hands/press_p99": 200 / 3,
    "hands/release_p50": 50 / 3,
    "hands/release_p99": math.inf,
}
STATUS = snapshot(VALUES, checks=judge(VALUES, PRESETS["robot"]))


def started(path: Path, resumed_at: int | None = None) -> GatesCsvSink:
    sink = GatesCsvSink(path)
    sink.start(resumed_at)
    return sink


def read(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_each_check_has_a_column(tmp_path: Path) -> None:
    columns = GatesCsvSink(tmp_path).columns
    listed = [each.name.replace(" ", "_") for each in STATUS.checks]
    assert set(listed) < set(columns)
    assert {"following_frames", "recent_max-Q_deviation"} < set(columns)


def test_a_row_tells_values_and_which_are_red(tmp_path: Path) -> None:
    path = tmp_path / "gates.csv"
    table = started(path)
    table.write(STATUS)
    table.write(changed(STATUS, {"run/agent_steps": 2_000, "learning/pixel_deviation": None}))
    first, second = read(path)
    assert tuple(first) == table.columns
    assert first == {
        "seconds": "61.2",
        "agent_steps": "1000",
        "train_reward": "-20.5",
        "games": "7",
        "valid_frames": "0.25",
        "following_frames": "0.75",
        "pixel_deviation": "0.5",
        "max-Q_deviation": "",
        "recent_max-Q_deviation": "0.125",
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
    started(path).write(STATUS)
    started(path)
    assert read(path) == []


def test_resume_drops_what_came_after_the_checkpoint(tmp_path: Path) -> None:
    path = tmp_path / "gates.csv"
    table = started(path, 0)  # a run from before there was such a table
    for steps in (1_000, 2_000, 3_000):
        table.write(changed(STATUS, {"run/agent_steps": steps}))
    with path.open("a") as file:
        file.write("70.0,1500,,,,,,,,,,,valid fr")  # torn
    started(path, 2_000).write(changed(STATUS, {"run/agent_steps": 2_500}))
    assert [row["agent_steps"] for row in read(path)] == ["1000", "2000", "2500"]


def test_a_table_with_fewer_columns_is_carried_over(tmp_path: Path) -> None:
    path = tmp_path / "gates.csv"
    path.write_text(
        "seconds,agent_steps,valid_frames,refused_chunks,red\n"
        "1.0,500,0.5,0,valid frames\n"
        "2.0,1000,1\n"
        "3.0,1500,1,0,\n"
        "3.0,1500,1,0,,,\n"
        "4.0,2000,1,0,\n"
    )
    started(path, 1_500).write(changed(STATUS, {"run/agent_steps": 1_600}))
    old, newer, new = read(path)
    empty = dict.fromkeys(GatesCsvSink(path).columns, "")
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
    endless = (f"agent_steps\n{'1' * digits}\n" for digits in (5_000, 200_000))
    for noise in ("", "\n", "noise", "a,b\n1,2\n", "agent_steps\n-1\n", *endless):
        path.write_text(noise)
        started(path, 1_000).write(STATUS)
        assert [row["agent_steps"] for row in read(path)] == ["1000"]
