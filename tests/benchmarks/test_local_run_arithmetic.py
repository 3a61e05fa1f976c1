"""What `benchmarks.local_run` and `epochs_per_day` make of what they counted."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import epochs_per_day
from benchmarks.local_run import (
    ROLES,
    Pace,
    Setting,
    _cpu_times,
    cpu_share,
    deadlines_kept,
    rate_of_tests,
)
from common.command_line.parser import check_bounds
from common.errors import InputError
from common.protocol.actor_stats import ActorStats, Role
from common.settings.clock import ClockConfig


def stats(
    role: Role, incarnation: int, steps: int = 0, decisions: int = 0, missed: int = 0
) -> ActorStats:
    return ActorStats(
        f"{role}-{incarnation}",
        role,
        incarnation,
        steps=steps,
        decisions=decisions,
        missed_deadlines=missed,
    )


def pace(train: float, test: float = 0.0) -> Pace:
    return Pace(
        seconds=10.0,
        train_steps_per_second=train,
        updates_per_second=train / 4,
        test_steps_per_second=test,
        samples_per_insert=8.0,
        staleness_p50=20.0,
        staleness_p95=40.0,
        deadlines_kept=None,
        cpu_share={"learner": 0.5, "actors": 0.25, "evaluator": 0.125},
    )


def test_each_evaluator_counts_between_its_own_heartbeats() -> None:
    heard = [
        (0.0, stats("evaluator", 1, steps=100)),
        (0.5, stats("evaluator", 2, steps=1_000)),
        (1.0, stats("actor", 3, steps=5_000)),
        (2.0, stats("evaluator", 1, steps=300)),
        (2.5, stats("evaluator", 2, steps=1_100)),
        (4.0, stats("evaluator", 1, steps=500)),
    ]
    assert rate_of_tests(heard) == pytest.approx(400 / 4 + 100 / 2)
    assert rate_of_tests(heard[:3]) == 0.0


def test_deadlines_of_actors_only_and_since_the_window_began() -> None:
    heard = [
        (0.0, stats("actor", 1, decisions=1_000, missed=900)),
        (0.0, stats("actor", 2, decisions=50, missed=0)),
        (0.5, stats("evaluator", 3, decisions=10, missed=0)),
        (1.0, stats("evaluator", 3, decisions=500, missed=400)),
        (1.0, stats("actor", 1, decisions=1_060, missed=901)),
        (1.5, stats("actor", 2, decisions=90, missed=0)),
    ]
    assert deadlines_kept(heard) == pytest.approx(0.99)
    assert deadlines_kept(heard[:3]) is None


def test_shares_of_processor_time_are_of_all_cores() -> None:
    cores = len(os.sched_getaffinity(0))
    before = {1: ("learner", 10.0), 2: ("actors", 1.0), 3: ("actors", 2.0)}
    after = {
        1: ("learner", 14.0),
        2: ("actors", 3.0),
        3: ("actors", 3.0),
        4: ("evaluator", 0.5),
    }
    found = cpu_share(before, after, 10.0)
    assert tuple(found) == ROLES
    assert found == pytest.approx(
        {"learner": 0.4 / cores, "actors": 0.3 / cores, "evaluator": 0.05 / cores}
    )


def test_processes_are_told_apart(tmp_path: Path) -> None:
    child = "import sys; print('started', flush=True); sys.stdin.read()"
    children = [
        subprocess.Popen(
            [sys.executable, "-c", child, *flags], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        for flags in ([], ["--evaluator"])
    ]
    try:
        for each in children:
            # Until a process has its own program, the kernel gives it an empty command line.
            assert each.stdout is not None
            assert each.stdout.readline() == b"started\n"
        found = _cpu_times(os.getpid())
        assert found[os.getpid()][0] == "learner"
        assert found[os.getpid()][1] == pytest.approx(sum(os.times()[:2]), abs=0.5)
        assert [found[each.pid][0] for each in children] == ["actors", "evaluator"]
        assert os.getppid() not in found
    finally:
        for each in children:
            each.communicate()


def test_epochs_a_day_end_to_end_and_overlapped() -> None:
    paces = epochs_per_day.Paces(pace(200.0, 0.0), pace(150.0, 500.0), 1_000.0)
    # 1,250 s of training and 125 s of testing.
    assert paces.epochs_per_day == pytest.approx(86_400 / 1_375)
    # Beside the test 37,500 steps are trained, the other 212,500 at 200 a second.
    assert paces.epochs_per_day_overlapped == pytest.approx(86_400 / (250 + 1_062.5))


def test_a_test_slower_than_training_sets_the_pace() -> None:
    paces = epochs_per_day.Paces(pace(300.0), pace(250.0, 50.0), 1_000.0)
    assert paces.epochs_per_day_overlapped == pytest.approx(86_400 / 2_500)


def test_no_test_no_epochs() -> None:
    paces = epochs_per_day.Paces(pace(200.0), pace(150.0, 0.0), 0.0)
    assert paces.epochs_per_day is None
    assert paces.epochs_per_day_overlapped is None


def test_summary_names_what_it_measured() -> None:
    found = epochs_per_day.summary(
        Setting(actors=2), epochs_per_day.Paces(pace(200.0), pace(150.0, 500.0), 1_000.0)
    )
    assert found["train_steps_per_second"] == 200.0
    assert found["train_steps_per_second_beside_test"] == 150.0
    assert found["test_steps_per_second"] == 1_000.0
    assert found["test_steps_per_second_beside_training"] == 500.0
    assert found["updates_per_second"] * 32 / found["train_steps_per_second"] == 8.0
    assert found["cpu_share"] == {"learner": 0.5, "actors": 0.25, "evaluator": 0.125}
    assert found["actors"] == 2
    assert found["windows"]["testing"]["test_steps_per_second"] == 500.0


def test_a_setting_tells_the_minibatches_that_it_has() -> None:
    assert str(Setting()) == "pong (ale), batches of 32, an update per 4 steps"
    assert str(Setting(env="robot", game="breakout", learner="--learning.batch-size 64")) == (
        "breakout (robot), batches of 64, an update per 4 steps"
    )


@pytest.mark.parametrize(
    "setting",
    [
        Setting(env="ale", clock=ClockConfig(sync=False)),
        Setting(env="ale", clock=ClockConfig(wait_action=True)),
    ],
)
def test_settings_that_cannot_work(setting: Setting) -> None:
    with pytest.raises(InputError, match="robot"):
        setting.check()
    with pytest.raises(InputError, match="actors"):
        check_bounds(Setting(actors=0))
