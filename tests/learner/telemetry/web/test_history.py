"""The curves that a page gets when it is opened late, or goes on."""

import json

from learner.telemetry.web.history import History


def points(history: History, thinned: int = -1, count: int = 0) -> list[tuple[int, float | None]]:
    told = history.since(thinned, count)
    return list(zip(told["steps"], told["values"]["learning/loss"], strict=True))


def grown(most: int, count: int) -> History:
    history = History(["learning/loss"], most)
    for i in range(count):
        history.add({"run/agent_steps": 10 * i, "learning/loss": float(i)})
    return history


def test_a_page_gets_what_it_lacks() -> None:
    history = grown(8, 5)
    assert points(history) == [(10 * i, float(i)) for i in range(5)]
    assert points(history, 0, 3) == [(30, 3.0), (40, 4.0)]
    assert points(history, 0, 5) == []
    # A page that knows of more than there is was opened on another run.
    assert len(points(history, 0, 6)) == len(points(history, 0, -7)) == 5


def test_a_long_run_keeps_evenly_spread_points() -> None:
    # After the ninth there are 0, 2 … 8; after the 17th 0, 4 … 16; then each fourth is taken.
    assert points(grown(8, 9), 0, 3) == [(10 * i, float(i)) for i in range(0, 9, 2)]
    assert points(grown(8, 27)) == [(10 * i, float(i)) for i in range(0, 27, 4)]
    assert len(points(grown(8, 10_000))) <= 8


def test_what_is_unknown_or_infinite_is_a_gap() -> None:
    history = History(["learning/loss"])
    for loss in (None, float("inf"), float("nan"), 1.5):
        history.add({"run/agent_steps": 1, "learning/loss": loss})
    assert json.loads(json.dumps(history.since(0, 0), allow_nan=False))["values"] == {
        "learning/loss": [None, None, None, 1.5]
    }
