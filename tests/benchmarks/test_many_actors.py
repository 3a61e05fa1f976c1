"""`benchmarks.many_actors` with real sessions, for a moment."""

import os

import pytest

from benchmarks import many_actors
from benchmarks.child import cpu_seconds, stat_of
from common.process.footprint import footprint


@pytest.mark.parametrize("router", [False, True])
def test_all_actors_are_heard_and_hear_the_weights(
    monkeypatch: pytest.MonkeyPatch, router: bool
) -> None:
    # In one piece: of many, Zenoh may drop some on a busy machine, and with them the weights.
    monkeypatch.setattr(many_actors, "WEIGHTS_BYTES", 1_000)
    options = many_actors.Options(
        numbers=(3,), seconds=1.1, chunk_steps=8, capacity=2_000, router=router
    )
    found = many_actors.measure_number(options, 3)
    due = 6  # two of each: an actor has 8 steps every 8/15 s
    assert found["chunks"] == found["acknowledged"] == due
    assert found["seconds"] >= due * 8 / 45, "the last chunk's steps take time, too"
    assert found["steps_per_second"] == pytest.approx(due * 8 / found["seconds"])
    assert 0 < found["p50_ms"] <= found["p99_ms"]
    assert found["weights_arrived"] == 3
    assert found["weights_seconds"] > 0
    assert found["hub_bytes"] > 10_000_000  # Python alone has more
    assert set(many_actors.row(found)) >= {"actors", "steps/s", "cores"}
    assert ("router" in many_actors.row(found)) == router


@pytest.mark.slow
def test_a_hub_takes_more_sessions_than_zenoh_does_by_itself() -> None:
    found = many_actors.measure_number(many_actors.Options(seconds=5.0), 1_024)
    assert found["acknowledged"] == found["chunks"] == 1_200


def test_usage_is_that_of_the_process_asked_for() -> None:
    own, first = os.getpid(), 1
    assert footprint(own).private > 10_000_000
    assert footprint(own).private != footprint(first).private
    assert cpu_seconds(stat_of(own)) > 0
    assert int(stat_of(own)[1]) == os.getppid()
    assert cpu_seconds(stat_of(own)) != cpu_seconds(stat_of(first))
