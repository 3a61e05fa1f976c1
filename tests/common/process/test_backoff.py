"""How long a process that ended waits before it is started again."""

import pytest

from common.process.backoff import growing_pause


@pytest.mark.parametrize(
    ("ends", "pause"), [(0, 0.0), (1, 1.0), (2, 2.0), (6, 32.0), (7, 60.0), (100_000, 60.0)]
)
def test_pauses_double_up_to_a_minute(ends: int, pause: float) -> None:
    assert growing_pause(ends) == pause
