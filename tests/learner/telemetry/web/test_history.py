"""The curves that a page gets when it is opened late, or goes on."""

import json

from learner.telemetry.web.history import History


def points(
    history: History, count: int = 0, version: int | None = None
) -> list[tuple[int, float | None]]:
    """What a page gets that has ``count`` points, by default of this history's present version."""
    told = history.since(version_of(history) if version is None else version, count)
    return list(zip(told["steps"], told["values"]["learning/loss"], strict=True))


def version_of(history: History) -> int:
    version = history.since(-1, 0)["version"]
    assert isinstance(version, int)
    return version


def grown(most: int, count: int) -> History:
    history = History(["learning/loss"], most)
    for i in range(count):
        history.add({"run/agent_steps": 10 * i, "learning/loss": float(i)})
    return history


def test_a_page_gets_what_it_lacks() -> None:
    history = grown(8, 5)
    assert points(history) == [(10 * i, float(i)) for i in range(5)]
    assert points(history, 3) == [(30, 3.0), (40, 4.0)]
    assert points(history, 5) == []
    assert len(points(history, 6)) == len(points(history, -7)) == 5


def test_a_page_that_was_opened_on_an_earlier_process_begins_anew() -> None:
    """Its points, though as many, may be of other steps."""
    assert len(points(grown(8, 5), 3, version_of(grown(8, 3)))) == 5


def test_a_long_run_keeps_evenly_spread_points() -> None:
    # After the ninth there are 0, 2 … 8; after the 17th 0, 4 … 16; then each fourth is taken.
    history = grown(8, 8)
    version = version_of(history)
    history.add({"run/agent_steps": 80, "learning/loss": 8.0})
    assert points(history, 3, version) == [(10 * i, float(i)) for i in range(0, 9, 2)]
    assert points(grown(8, 27)) == [(10 * i, float(i)) for i in range(0, 27, 4)]
    assert len(points(grown(8, 10_000))) <= 8


def test_what_is_unknown_or_infinite_is_a_gap() -> None:
    history = History(["learning/loss"])
    for loss in (None, float("inf"), float("nan"), 1.5):
        history.add({"run/agent_steps": 1, "learning/loss": loss})
    assert json.loads(json.dumps(history.since(0, 0), allow_nan=False))["values"] == {
        "learning/loss": [None, None, None, 1.5]
    }
