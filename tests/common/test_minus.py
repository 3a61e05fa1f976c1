"""The minus sign of numbers on screens."""

import pytest

from common.minus import minus_signed


@pytest.mark.parametrize(
    ("number", "told"), [("-0.5", "−0.5"), ("  1.0", "  1.0"), ("-4e-07", "−4e-07"), ("", "")]
)
def test_only_the_sign_is_another(number: str, told: str) -> None:
    assert minus_signed(number) == told
