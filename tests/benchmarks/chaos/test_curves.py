"""Curves with and without faults are compared in pairs."""

import pytest

from benchmarks.chaos import curves
from benchmarks.chaos.curves import Options, interval, measure


def test_the_interval_of_paired_differences() -> None:
    mean, half = interval([0.1, 0.2, 0.3])
    assert mean == pytest.approx(0.2)
    assert half == pytest.approx(4.303 * 0.1 / 3**0.5)
    assert interval([0.5, 0.5]) == (0.5, 0.0)


@pytest.mark.parametrize(
    ("harm", "agree"),
    [((0.0, 0.0, 0.0), True), ((0.3, 0.3, 0.3), False), ((-0.2, 0.2, 0.0), False)],
    ids=["equal", "worse", "too uncertain"],
)
def test_curves_agree_where_the_intervals_lie_within_the_margin(
    monkeypatch: pytest.MonkeyPatch, harm: tuple[float, ...], agree: bool
) -> None:
    def run(_: Options, seed: int, *, faults: bool) -> tuple[list[float], int]:
        lost = harm[seed - 1] if faults else 0.0
        return [-0.5, 0.5, 0.9 - lost, 0.9 - lost, 0.9 - lost], 9 if faults else 0

    monkeypatch.setattr(curves, "_run", run)
    report = measure(Options(seeds=3, margin=0.2))
    assert report.content["agree"] is agree
    assert [row["faults"] for row in report.content["rows"]] == [9, 9, 9]
    last = report.content["differences"]["last"]
    assert last["mean"] == pytest.approx(-sum(harm) / 3)
    whole = report.content["differences"]["all"]
    assert whole["mean"] == pytest.approx(-sum(harm) / 5)  # three of five epochs are worse
