"""What robots need, against numbers that are computed by hand."""

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.figures.needs import needs
from benchmarks.figures.results_page import render
from benchmarks.peers import against_ours
from common.errors import InputError

ABOUT = {
    "versions": {"torch": "2.13.0"},
    "git_commit": "0123456789abcdef",
    "machine": {"cpu": "A processor", "cores": 2},
}


def hub(actors: int, cores: float) -> dict[str, Any]:
    weights = {"weights_arrived": actors, "weights_seconds": 4.0}
    return {"actors": actors, "hub_cores": cores, "hub_bytes_per_actor": 50e3, **weights}


RESULTS: dict[str, dict[str, Any]] = {
    "actor_steps": {"robot": {"1": 150.0}},
    "peers": {
        "rows": against_ours("updates of 32, 1 thread", {"peer": [9.0], "ours": [25.0]})
        + against_ours("updates of 32, 2 threads", {"peer": [9.0], "ours": [50.0]})
        + against_ours("insert steps", {"peer": [9.0], "ours": [1e6]})
    },
    "transport": {
        "insert": {"megabytes_per_second": 100.0, "transitions_per_second": 10_000.0},
        "insert_at_once": {"transitions_per_second": 30_000.0},
        "sample": {"megabytes_per_second": 200.0, "calls_per_second": 100.0},
    },
    "many_actors": {
        "many_actors": [
            hub(20, 0.1) | {"p99_ms": 1.0},
            hub(100, 0.25) | {"p99_ms": 2.0},
            hub(500, 0.5) | {"p99_ms": 3.0},
        ]
    },
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, found in RESULTS.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(found | ABOUT))
    return tmp_path


def test_each_part(folder: Path) -> None:
    found = {what: (numbers, how, limit) for what, *numbers, how, limit in needs(folder)}
    expected = {
        "agent steps/s": ("150.0", "1,500.0", "15,000.0"),
        "cores for actors": ("1", "10.0", "100.0"),
        "cores for the hub": ("0.05", "0.25", "1"),
        "MB of the hub for connections": ("0.5", "5", "50.0"),
        "p99 ms until a chunk is acknowledged": ("1", "2", "3"),
        "share of what the replay takes": ("0.005", "0.05", "0.5"),
        "MB/s of chunks": ("1.5", "15.0", "150.0"),
        "updates/s, one per 4 steps": ("37.5", "375.0", "3,750.0"),
        "learners of two cores that it would take": ("0.75", "7.5", "75.0"),
        "`--learning.train-period` that one such learner keeps up with": ("4", "30.0", "300.0"),
        "MB/s of minibatches, if replay and learner are on two machines": (
            *("75.0", "100.0", "100.0"),
        ),
        "MB/s of weights, each 50 updates": ("50.2", "670.0", "6,700.0"),
        "`--learning.publish-period` for 100 MB/s of them": ("50.0", "335.0", "3,350.0"),
    }
    assert {what: tuple(numbers) for what, (numbers, _, _) in found.items()} == expected
    limits = {what: limit for what, (_, _, limit) in found.items() if limit}
    assert limits == {
        "cores for actors": "a core at 10 robots",
        "cores for the hub": "a core at 1,000 robots; connections at 4,096",
        "share of what the replay takes": "at 2,000 robots",
        "MB/s of chunks": "1 Gbit/s at 833 robots",
        "updates/s, one per 4 steps": "two cores at 13 robots",
        "MB/s of minibatches, if replay and learner are on two machines": (
            "1 Gbit/s at 62 updates/s"
        ),
        "MB/s of weights, each 50 updates": "1 Gbit/s at 19 robots",
    }
    known = {what for what, (_, how, _) in found.items() if how.startswith("measured with 20, 100")}
    assert known == {
        "cores for the hub",
        "MB of the hub for connections",
        "p99 ms until a chunk is acknowledged",
    }


def test_the_page_has_it_over_where_each_number_was_measured(folder: Path) -> None:
    page = render("<!-- needs of robots -->\n<!-- end -->\n", folder)
    lines = page.splitlines()
    assert lines[1].startswith("| what | 10 robots | 100 robots | 1,000 robots | how it is known |")
    assert "many_actors.json: A processor, 2 cores, torch 2.13.0, commit 0123456." in lines
    assert render(page, folder) == page


def test_the_hub_with_the_nearest_number_of_actors_counts_and_periods_are_whole(
    folder: Path,
) -> None:
    hubs = [*RESULTS["many_actors"]["many_actors"], hub(1_900, 1.9) | {"p99_ms": 4.0}]
    peers = {"rows": against_ours("updates of 32, 1 thread", {"peer": [9.0], "ours": [40.0]})}
    (folder / "many_actors.json").write_text(json.dumps({"many_actors": hubs}))
    (folder / "peers.json").write_text(json.dumps(peers))
    rows = {what: cells for what, *cells in needs(folder)}
    assert rows["p99 ms until a chunk is acknowledged"][:3] == ["1", "2", "4"]
    assert "1,900 of 1,900 actors" in rows["MB/s of weights, each 50 updates"][3]
    period = "`--learning.train-period` that one such learner keeps up with"
    assert rows[period][:3] == ["4", "38.0", "375.0"]


@pytest.mark.parametrize("name", RESULTS)
def test_what_is_missing_is_told(folder: Path, name: str) -> None:
    told = r"needs actor_steps.json, many_actors.json, .*make bench"
    (folder / f"{name}.json").write_text("{}")
    with pytest.raises(InputError, match=told):
        list(needs(folder))
    (folder / f"{name}.json").unlink()
    with pytest.raises(InputError, match=told):
        list(needs(folder))
