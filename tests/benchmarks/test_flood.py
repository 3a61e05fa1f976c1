"""`benchmarks.flood` with real processes, for a moment, and what it makes of what they told."""

import pytest

from benchmarks import catch, flood
from benchmarks.flood import ALONE, BUSY, FLOODED, Options
from benchmarks.flood_training import Mark, rates
from common.registry import ENVIRONMENTS
from tests.extending.whole_run import added


@pytest.mark.usefixtures("forks")
def test_a_flood_is_turned_away_and_training_goes_on() -> None:
    # So small a quota that any machine sends more, which is waited for; what follows is short.
    options = Options(turns=1, seconds=0.5, settle=0.1, quota=200)
    with added(ENVIRONMENTS, catch.CATCH):
        content = flood.measure(options).content
    (alone,), (flooded,), (busy,) = (content["turns"][kind] for kind in (ALONE, FLOODED, BUSY))
    assert alone["updates"] > 0
    assert alone["heartbeats_heard"] == 0
    assert "chunks" not in alone
    assert flooded["updates"] > 0
    assert flooded["chunks"] >= flooded.get("chunks stored", 0)
    assert flooded["refused"] == 0  # nothing is wrong with the chunks
    # On a slow machine the hub has cut the flooder off by then, or its turn is too short for a
    # heartbeat between its chunks.
    assert flooded["heartbeats"] > flooded["heartbeats_heard"] or flooded["heartbeats"] == 0
    assert {"chunk bytes", "requests"} <= set(flooded)
    assert busy["cpu"] > 0
    assert "chunks" not in busy
    ratio = flooded["updates"] / busy["updates"]
    assert content["ratio"] == {"median": ratio, "least": ratio, "most": ratio}


def _values(updates: int, seconds: float, over_quota: int) -> dict[str, float]:
    return {
        "learning/updates": updates,
        "run/seconds": seconds,
        "stream/over_quota": over_quota,
        "stream/chunks_refused": 0,
    }


def test_updates_and_steps_are_counted_by_the_clocks_of_those_who_make_them() -> None:
    first = Mark(_values(100, 10.0, 5), 50.0, 3.0, (1_000, 20.0), 7, {"chunks": 20})
    sent = {"chunks": 70, "requests": 10}
    last = Mark(_values(500, 14.0, 45), 55.0, 8.0, (1_500, 24.0), 107, sent)
    assert rates(first, last) == {
        "updates": 100.0,
        "agent_steps": 125.0,
        "learner_cores": 1.0,
        "over_quota": 8.0,
        "refused": 0.0,
        "heartbeats_heard": 20.0,
        "chunks": 10.0,
        "requests": 2.0,
    }


def test_turns_are_compared_in_pairs() -> None:
    found = {
        ALONE: [{"updates": 200.0}, {"updates": 100.0}, {"updates": 160.0}],
        FLOODED: [
            {"updates": 90.0, "chunks": 400.0, "chunks stored": 100.0, "chunk bytes": 2e8},
            {"updates": 40.0, "chunks": 200.0, "chunks stored": 100.0, "chunk bytes": 1e8},
            {"updates": 76.0, "chunks": 500.0, "chunks stored": 125.0, "chunk bytes": 3e8},
        ],
        BUSY: [{"updates": 100.0}, {"updates": 50.0}, {"updates": 80.0}],
    }
    content = flood.report(found).content
    assert content["ratio"] == {"median": 0.9, "least": 0.8, "most": 0.95}
    alone, flooded, busy = content["rows"]
    assert (alone["updates/s"], alone["least"], alone["most"]) == (160, 100, 200)
    assert (alone["of alone"], busy["of alone"]) == (1, 0.5)
    assert (flooded["updates/s"], flooded["of alone"]) == (76, 0.45)
    chunks, heartbeats, _ = content["refusals"]
    assert (chunks["sent/s"], chunks["taken/s"], chunks["refused"]) == (400, 100, 0.75)
    assert chunks["why"] == "200 MB/s; over quota or turn"
    assert heartbeats["refused"] is None  # none was sent
