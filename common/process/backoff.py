"""Growing pauses before a process that ended is restarted."""

FIRST_PAUSE = 1.0
LONGEST_PAUSE = 60.0
SETTLED = 600.0
"""Seconds of work after which earlier ends are forgotten."""
_MAX_DOUBLINGS = 10


def growing_pause(ends: int) -> float:
    """Returns the seconds to wait after so many ends in a row: 0 after none, then 1, 2, 4 … 60."""
    if not ends:
        return 0.0
    return min(FIRST_PAUSE * 2.0 ** min(ends - 1, _MAX_DOUBLINGS), LONGEST_PAUSE)
