"""Curves, read back with TensorBoard's own reader."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from common.press_latency import Delay
from learner.telemetry.sinks.epochs_csv import EpochRow
from learner.telemetry.sinks.tensorboard import Curves
from learner.telemetry.status import ActorStatus, ChunkCounts, Gate, Status

STATUS = Status(
    run="pong-1",
    preset="fast",
    env="ale",
    game="pong",
    device="cpu",
    phase="training",
    elapsed=60.0,
    agent_steps=1_000,
    warmup=500,
    warmup_done=500,
    epoch=1,
    epoch_steps=25_000,
    epsilon=0.5,
    updates=125,
    loss=0.25,
    samples_per_insert_goal=8.0,
    capacity=200_000,
    chunks=ChunkCounts(made=17, acked=15, refused=1),
    actors=(
        ActorStatus(name="actor-0", role="actor", alive=True),
        ActorStatus(name="actor-1", role="actor", alive=False),
    ),
    press=Delay(1_224, 50.0, 66.5, 66.5),
    release=Delay(1_301, 16.5, 33.5, 50.0),
    gates=(
        Gate(name="valid frames", value=0.5, passed=False, bound="≥ 0.99", why="no screen"),
        Gate(name="max-Q deviation", value=None, passed=None, bound="> 0", why="blind"),
    ),
)
ROW = EpochRow(
    epoch=1,
    phase="test",
    steps=12_500,
    nr_games=10,
    average_reward=-20.5,
    min_game_reward=-21.0,
    max_game_reward=-19.0,
    last_exploration_rate=0.05,
    total_train_steps=25_000,
    replay_memory_count=25_500,
    meanq=0.75,
    meancost=0.0,
    weight_updates=6_250,
    total_time=100.0,
    epoch_time=25.0,
    steps_per_second=500.0,
)


def read(folder: Path) -> dict[str, list[tuple[int, float]]]:
    events = EventAccumulator(str(folder))
    events.Reload()
    return {
        tag: [(point.step, point.value) for point in events.Scalars(tag)]
        for tag in events.Tags()["scalars"]
    }


def test_status_and_epochs_over_agent_steps(tmp_path: Path) -> None:
    with Curves(tmp_path) as curves:
        curves.status(STATUS)
        curves.status(replace(STATUS, agent_steps=2_000, loss=0.125))
        curves.epoch(ROW, 25_500)
    points = read(tmp_path)
    assert points["learning/loss"] == [(1_000, 0.25), (2_000, 0.125)]
    assert points["learning/updates"] == [(1_000, 125), (2_000, 125)]
    assert points["stream/chunks_made"][0] == (1_000, 17)
    assert points["stream/actors_alive"][0] == (1_000, 1)
    assert points["gates/valid_frames"][0] == (1_000, 0.5)
    assert points["gates/failed"][0] == (1_000, 1)
    assert points["gates/press_p50_ms"][0] == (1_000, 50.0)
    assert "gates/press_p99_ms" not in points  # that of the gate, which this status lacks
    assert points["gates/release_p50_ms"][0] == (1_000, 16.5)
    assert points["gates/release_p99_ms"][0] == (1_000, 33.5)
    assert points["play/epoch_test_reward"] == [(25_500, -20.5)]
    assert points["learning/epoch_test_mean_max_q"] == [(25_500, 0.75)]
    assert {tag.split("/")[0] for tag in points} == {"play", "learning", "stream", "gates"}


def test_the_unknown_has_no_point(tmp_path: Path) -> None:
    with Curves(tmp_path) as curves:
        curves.status(STATUS)
        curves.epoch(replace(ROW, average_reward=None), 25_500)
    points = read(tmp_path)
    assert "learning/mean_max_q" not in points
    assert "gates/max-Q_deviation" not in points
    assert "play/epoch_test_reward" not in points


def test_resume_forgets_the_life_that_was_lost(tmp_path: Path) -> None:
    with Curves(tmp_path) as curves:
        for steps, loss in ((1_000, 4.0), (2_000, 2.0), (3_000, 1.0)):
            curves.status(replace(STATUS, agent_steps=steps, loss=loss))
    with Curves(tmp_path, resumed_at=2_000) as curves:
        curves.status(replace(STATUS, agent_steps=2_500, loss=8.0))
    assert read(tmp_path)["learning/loss"] == [(1_000, 4.0), (2_000, 2.0), (2_500, 8.0)]


def test_import_is_light_and_silent() -> None:
    code = "import sys, learner.telemetry.sinks.tensorboard; assert 'torch' not in sys.modules"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")
