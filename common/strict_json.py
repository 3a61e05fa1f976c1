"""JSON for programs that read strictly: without infinity and NaN, which JSON does not have."""

import json
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


def dumps(value: Any) -> str:
    """Returns ``value`` as indented strict JSON of ASCII, which any terminal and pipe takes."""
    return json.dumps(strict(value), indent=2, allow_nan=False)
