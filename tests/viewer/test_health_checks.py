"""The health checks of --check at their bounds."""

import math

import pytest

from viewer.health_checks import judge


def colours(
    deviation: float, valid: float | None, corners: float | None, match: float | None
) -> list[bool]:
    checks = judge(
        pixel_deviation=deviation, valid_share=valid, corners_share=corners, match_share=match
    )
    return [check.green for check in checks]


@pytest.mark.parametrize(
    ("figures", "expected"),
    [
        ((1.0, 0.99, 0.99, 0.5), [True] * 4),
        ((0.99, 0.99, 0.99, 0.5), [False, True, True, True]),
        ((30.0, 0.98, 0.99, 0.5), [True, False, True, True]),
        ((30.0, 1.0, 0.9, 0.5), [True, True, False, True]),
        ((30.0, 1.0, 1.0, 0.49), [True, True, True, False]),
        ((math.nan, 1.0, 1.0, 1.0), [False, True, True, True]),
        ((30.0, None, None, None), [True]),
    ],
)
def test_bounds(
    figures: tuple[float, float | None, float | None, float | None], expected: list[bool]
) -> None:
    assert colours(*figures) == expected
