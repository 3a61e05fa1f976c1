"""What a declaration says about its settings."""

from typing import Annotated, Any, Literal

import pytest
from annotated_types import Ge, Gt, Le, Lt

from common.checked import Count
from common.run.meanings import bounds


@pytest.mark.parametrize(
    ("hint", "said"),
    [
        (Annotated[int, Ge(1), Le(2_000)], "integer, 1 to 2,000"),
        (Count, "integer, 0 or more"),
        (Annotated[float, Ge(0), Lt(1)], "0 to below 1"),
        (Annotated[float, Gt(0)], "above 0"),
        (Annotated[float, Gt(0), Le(9.0)], "above 0 to 9"),
        (Annotated[float, Le(0.5)], "at most 0.5"),
        (float, "number"),
        (int, "integer"),
        (str, "text"),
        (bool, "yes, no"),
        (Literal["max", "mean"], "max, mean"),
    ],
)
def test_bounds(hint: Any, said: str) -> None:
    assert bounds(hint) == said
