"""What counts as of late, on a clock that the test turns."""

from common.metrics import METRICS, number
from common.press_latency import COUNTS, ms_of, place_of
from learner.telemetry.recent_latency import RecentLatency


def counts(*presses: tuple[int, int]) -> tuple[int, ...]:
    """So many presses that took so many frames each."""
    found = [0] * COUNTS
    for count, frames in presses:
        found[place_of("press", True, frames)] = count
    return tuple(found)


class Looks:
    def __init__(self) -> None:
        self.now = 100.0
        self.latency = RecentLatency(lambda: self.now)

    def p50(self, now: float, told: tuple[int, ...]) -> tuple[int, int]:
        """Frames that half of the presses took, of late and over the run."""
        self.now = now
        values = self.latency.values(told)
        assert values.keys() <= METRICS.keys()
        late, in_all = (number(values, f"{scope}/press_p50") for scope in ("hands", "run"))
        assert late is not None
        assert in_all is not None
        return round(late / ms_of(1)), round(in_all / ms_of(1))


def test_before_anybody_has_told_nothing_is_known() -> None:
    values = RecentLatency().values(())
    for scope in ("hands", "run"):
        assert values[f"{scope}/press_p99"] is values[f"{scope}/release_p50"] is None
        assert values[f"{scope}/press_measured"] == 0


def test_a_fault_shows_at_once_and_is_over_a_minute_after_it_ended() -> None:
    looks = Looks()
    assert looks.p50(0.0, counts((5_000, 3))) == (3, 3)  # of a checkpoint: all there is
    assert looks.p50(10.0, counts((5_000, 3), (99, 9))) == (3, 3)  # too few to tell
    assert looks.p50(20.0, counts((5_000, 3), (100, 9))) == (9, 3)
    assert looks.p50(30.0, counts((5_090, 3), (100, 9))) == (9, 3)
    assert looks.p50(75.0, counts((5_200, 3), (101, 9))) == (3, 3)


def test_of_a_new_run_everything_is_of_late() -> None:
    looks = Looks()
    looks.latency.values(())
    looks.p50(110.0, counts((10, 3)))
    told = counts((10, 3), (150, 4))
    assert looks.p50(120.0, told) == (4, 4)
    assert looks.latency.values(told)["hands/press_measured"] == 160
