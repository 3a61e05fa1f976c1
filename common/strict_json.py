"""`strict`: makes values fit for JSON, which has neither infinity nor NaN."""

import math
from typing import Any


def strict(value: Any) -> Any:
    """Returns ``value`` with None in place of each infinity and NaN, at any depth."""
    if isinstance(value, dict):
        return {name: strict(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [strict(inner) for inner in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
