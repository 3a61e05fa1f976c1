"""The minus sign of numbers on screens."""

import pytest

from common.minus import minus_signed, points


@pytest.mark.parametrize(
    ("number", "told"),
    [
        ("-0.5", "−0.5"),
        ("  1.0", "  1.0"),
        ("-4e-07", "−4e-07"),
        ("", ""),
        ("-0.00", "0.00"),
        ("-0", "0"),
    ],
)
def test_only_the_sign_is_another(number: str, told: str) -> None:
    assert minus_signed(number) == told


@pytest.mark.parametrize(
    ("score", "told"), [(-21.0, "−21"), (0.0, "0"), (1_234_567.0, "1234567"), (-20.5, "−20.5")]
)
def test_a_score_is_written_whole(score: float, told: str) -> None:
    assert points(score) == told
