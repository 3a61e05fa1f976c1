"""What counts as of late, on a clock that the test turns."""

from common.press_latency import COUNTS, UNMEASURED, ms_of, place_of
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
        self.delays = RecentLatency(lambda: self.now)

    def p50(self, now: float, told: tuple[int, ...]) -> tuple[float | None, float | None]:
        """Frames that half of the presses took, of late and in all."""
        self.now = now
        self.delays.look(told)
        late, in_all = (each("press") for each in (self.delays.of_late, self.delays.in_all))
        assert late.p50 is not None
        assert in_all.p50 is not None
        return round(late.p50 / ms_of(1)), round(in_all.p50 / ms_of(1))


def test_before_anybody_has_told_nothing_is_known() -> None:
    delays = RecentLatency()
    delays.look(())
    assert delays.of_late("press") == delays.in_all("release") == UNMEASURED


def test_a_fault_shows_at_once_and_is_over_a_minute_after_it_ended() -> None:
    looks = Looks()
    assert looks.p50(0.0, counts((5_000, 3))) == (3, 3)  # of a checkpoint: all there is
    assert looks.p50(10.0, counts((5_000, 3), (99, 9))) == (3, 3)  # too few to tell
    assert looks.p50(20.0, counts((5_000, 3), (100, 9))) == (9, 3)
    assert looks.p50(30.0, counts((5_090, 3), (100, 9))) == (9, 3)
    assert looks.p50(75.0, counts((5_200, 3), (101, 9))) == (3, 3)


def test_of_a_new_run_everything_is_of_late() -> None:
    looks = Looks()
    looks.delays.look(())
    looks.p50(110.0, counts((10, 3)))
    assert looks.p50(120.0, counts((10, 3), (150, 4))) == (4, 4)
    assert looks.delays.of_late("press").measured == 160
