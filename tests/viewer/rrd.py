"""Reads a Rerun recording back, by Rerun itself."""

from collections import defaultdict
from pathlib import Path
from typing import Any

Rows = dict[int, Any]
"""Values by agent step; what is static is at -1."""


def recorded(path: Path) -> dict[str, dict[str, Rows]]:
    """By entity and component, such as ``Scalars:scalars``, the values that were logged."""
    from rerun.chunk import RrdReader

    found: dict[str, dict[str, Rows]] = defaultdict(lambda: defaultdict(dict))
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        steps = [-1] * chunk.num_rows
        if not chunk.is_static:
            assert set(chunk.timeline_names) == {"agent step", "game time"}
            steps = batch.column("agent step").to_pylist()
            times = batch.column("game time").cast("int64").to_pylist()
            found["game time"]["seconds"].update(
                {step: time / 1e9 for step, time in zip(steps, times, strict=True)}
            )
        for name in batch.schema.names:
            if ":" in name:
                values = batch.column(name).to_pylist()
                found[chunk.entity_path][name].update(
                    {s: v for s, v in zip(steps, values, strict=True) if v is not None}
                )
    return found


def at(rows: Rows, step: int) -> Any:
    """What is shown at ``step``: the last value that was logged until then."""
    return rows[max(logged for logged in rows if logged <= step)]
