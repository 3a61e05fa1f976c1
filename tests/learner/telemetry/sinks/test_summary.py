"""``summary.json``: its keys and values."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from common.metrics import Value
from common.protocol.actor_stats import ActorStats
from common.protocol.run_status import HealthCheck
from common.settings.presets import PRESETS
from learner.telemetry.sinks.summary import SummarySink
from learner.telemetry.snapshot import ActorView, Snapshot
from tests.learner.telemetry.snapshots import changed, snapshot

STATUS = snapshot(
    {
        "run/preset": "paper",
        "run/seed": 1,
        "run/initial": False,
        "run/phase": "finishing",
        "run/seconds": 3_600.0,
        "run/agent_steps": 300_000,
        "run/epoch": 2,
        "run/train_steps_per_second": 250.0,
        "run/epochs_per_day": 69.12,
        "learning/updates": 62_500,
        "learning/mean_max_q": 1.25,
        "play/test_reward": -19.5,
        "play/test_epoch": 2,
        "play/best_test_reward": -19.0,
        "stream/samples_per_insert": 8.01,
        "stream/staleness_p50": 12.0,
        "stream/staleness_p95": 48.0,
        "stream/weights_version": 1_250,
        "stream/stored": 300_000,
        "stream/capacity": 1_000_000,
        "stream/chunks_made": 4_690,
        "stream/chunks_acked": 4_688,
        "stream/chunks_retried": 3,
        "stream/chunks_duplicate": 1,
        "stream/over_quota": 5,
        "stream/shut_out": 2,
        "stream/chunks_refused": 2,
        "stream/chunks_excess": 0,
        "play/valid_frame_share": 1.0,
        "play/press_match_share": 0.75,
        "run/press_measured": 1_224,
        "run/press_p50": 50.0,
        "run/press_p99": math.inf,
        "run/press_watched": 66.5,
        "run/press_given_up": 0.02,
        "run/release_measured": 0,
        "run/release_watched": 0.0,
        "actors/elapsed_per_step": 2.0,
        "actors/missed_deadlines": 20,
        "actors/late_frames": 14,
        "actors/waits_given_up": 4,
        "run/sync": False,
        "run/wait_action": True,
        "run/speed": 0.5,
    },
    actors=(
        ActorView(
            stats=ActorStats(
                "actor-0", "actor", steps=300_000, valid=240_000, key_times=(1,) * 120
            ),
            alive=True,
        ),
    ),
    checks=(
        HealthCheck(name="valid frames", value=1.0, passed=True, bound="≥ 0.99", why="no screen"),
    ),
)
PROVENANCE = {
    "versions": {"python": "3.11.9", "torch": "2.13.0"},
    "git_commit": "a" * 40,
    "git_dirty": False,
    "machine": {
        "system": "Linux",
        "cpu": "a processor",
        "cores": 2,
        "memory_bytes": 2**33,
        "gpus": [],
    },
}


def written(path: Path, status: Snapshot = STATUS) -> Any:
    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    SummarySink(path, PRESETS["paper"], PROVENANCE).write(status)
    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


def test_keys_that_there_always_were_are_kept(tmp_path: Path) -> None:
    """As of the runs in benchmarks/results; `chunks.excess` and `given_up` came later."""
    summary = written(tmp_path / "summary.json")
    assert set(summary) >= {
        "run",
        "preset",
        "env",
        "game",
        "seed",
        "initial",
        "sync",
        "wait_action",
        "speed",
        "device",
        "wall_seconds",
        "agent_steps",
        "updates",
        "epoch",
        "games",
        "random_reward",
        "train_reward",
        "test_reward",
        "test_epoch",
        "best_test_reward",
        "epsilon",
        "loss",
        "mean_max_q",
        "held_out_std",
        "samples_per_insert",
        "samples_per_insert_goal",
        "stored",
        "capacity",
        "replay_process",
        "chunks",
        "weights_version",
        "staleness_updates",
        "steps_per_second",
        "test_steps_per_second",
        "updates_per_second",
        "epochs_per_day",
        "valid_frame_share",
        "press_match_share",
        "press_ms",
        "release_ms",
        "decisions_per_step",
        "missed_deadlines",
        "late_frames",
        "waits_given_up",
        "gates",
        "actors",
        "config",
        "versions",
        "git_commit",
        "git_dirty",
        "machine",
    }
    assert set(summary["replay_process"]) == {"private_bytes", "resident_bytes", "file_bytes"}
    (actor,) = summary["actors"]
    assert actor["valid_share"] == 0.8
    assert set(actor) >= {
        "name",
        "role",
        "alive",
        "steps",
        "steps_per_second",
        "epsilon",
        "weights_version",
        "made",
        "acked",
        "retried",
        "refused",
        "throttled_share",
        "valid_share",
        "match_share",
        "decisions",
        "missed_deadlines",
        "late_frames",
        "waits_given_up",
        "silent_for",
        "left",
    }
    assert set(summary["gates"][0]) == {"name", "value", "passed", "bound", "why", "stops"}


def test_figures_of_the_run(tmp_path: Path) -> None:
    summary = written(tmp_path / "summary.json")
    expected = {
        "agent_steps": 300_000,
        "updates": 62_500,
        "samples_per_insert": 8.01,
        "chunks": {
            "made": 4_690,
            "acked": 4_688,
            "retried": 3,
            "duplicate": 1,
            "over_quota": 5,
            "refused": 2,
            "excess": 0,
        },
        "shut_out": 2,
        "weights_version": 1_250,
        "staleness_updates": {"p50": 12.0, "p95": 48.0},
        "steps_per_second": 250.0,
        "epochs_per_day": 69.12,
        "mean_max_q": 1.25,
        "valid_frame_share": 1.0,
        "press_match_share": 0.75,
        "press_ms": {
            "measured": 1_224,
            "p50": 50.0,
            "p99": None,
            "watched": 66.5,
            "given_up": 0.02,
        },
        "release_ms": {"measured": 0, "p50": None, "p99": None, "watched": 0.0, "given_up": None},
        "versions": {"python": "3.11.9", "torch": "2.13.0"},
        "git_commit": "a" * 40,
        "git_dirty": False,
        "best_test_reward": -19.0,
        "seed": 1,
        "initial": False,
        "sync": False,
        "wait_action": True,
        "speed": 0.5,
        "decisions_per_step": 2.0,
        "missed_deadlines": 20,
        "late_frames": 14,
        "waits_given_up": 4,
    }
    assert {name: summary[name] for name in expected} == expected
    assert summary["machine"]["cores"] == 2
    assert summary["config"]["learning"]["batch_size"] == 32
    assert summary["gates"][0]["bound"] == "≥ 0.99"
    assert summary["actors"][0]["steps"] == 300_000


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, None])
def test_what_is_no_number_is_null(tmp_path: Path, value: float | None) -> None:
    check = STATUS.checks[0]._replace(value=value)
    values: dict[str, Value] = {"learning/mean_max_q": value, "stream/staleness_p95": value}
    diverged = changed(STATUS, values, checks=(check,))
    summary = written(tmp_path / "summary.json", diverged)
    assert summary["mean_max_q"] is None
    assert summary["staleness_updates"] == {"p50": 12.0, "p95": None}
    assert summary["gates"][0]["value"] is None


def test_an_older_summary_is_replaced_whole(tmp_path: Path) -> None:
    path = tmp_path / "summary.json"
    path.write_text("x" * 100_000)
    assert written(path)["run"] == "pong-1"
    assert [entry.name for entry in tmp_path.iterdir()] == ["summary.json"]
