"""What a declaration says about its settings."""

from dataclasses import dataclass, make_dataclass
from typing import Annotated, Any, Literal

import pytest
from annotated_types import Ge, Gt, Le, Lt

from common.checked import Count
from common.settings.meanings import bounds, docstrings


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
        (Annotated[int, Ge(1)] | None, "integer, 1 or more; or none"),
        (int | Annotated[float, Le(0.5)] | str, "integer; or at most 0.5; or text"),
        (int | None, "integer; or none"),
    ],
)
def test_bounds(hint: Any, said: str) -> None:
    assert bounds(hint) == said


@dataclass
class Declared:
    size: int
    """Number of lamps,
    all of them."""
    name: str


def test_what_is_said_of_fields() -> None:
    assert docstrings(Declared) == {"size": "Number of lamps, all of them."}
    assert docstrings(make_dataclass("Made", ["size"])) == {}
    assert docstrings(int) == {}
