"""`strict`: values as JSON has them, which knows no infinity and no NaN."""

import math
from typing import Any


def strict(value: Any) -> Any:
    """``value`` with None for every number that JSON does not have, also inside of it."""
    if isinstance(value, dict):
        return {name: strict(inner) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [strict(inner) for inner in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
