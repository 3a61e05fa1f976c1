"""``summary.json``: the present figures of a run, in one file that other programs can read.

Strict JSON: a figure that is unknown, infinite or not a number is null.
"""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from common.atomic_file import write_atomically
from common.metrics import METRICS
from common.settings.config import RunConfig
from common.strict_json import dumps
from learner.telemetry.sinks.sink import Sink
from learner.telemetry.snapshot import ActorView, Snapshot


@dataclasses.dataclass
class SummarySink(Sink):
    """Replaces the file at ``path`` atomically, every ten seconds and at the end."""

    path: Path
    config: RunConfig
    provenance: Mapping[str, Any]

    period = 10.0

    def write(self, snapshot: Snapshot) -> None:
        """Writes the figures that `METRICS` has for it, health checks, actors and settings."""
        summary: dict[str, Any] = {}
        for metric in METRICS.values():
            if metric.summary:
                outer, _, inner = metric.summary.rpartition(".")
                into = summary.setdefault(outer, {}) if outer else summary
                into[inner] = snapshot.values.get(metric.key)
        summary |= {
            "gates": [check._asdict() for check in snapshot.checks],
            "actors": [_of_actor(actor) for actor in snapshot.actors],
            "config": dataclasses.asdict(self.config),
            **self.provenance,
        }
        text = dumps(summary)
        write_atomically(self.path, (text + "\n").encode())


def _of_actor(actor: ActorView) -> dict[str, Any]:
    told = {**dataclasses.asdict(actor), **dataclasses.asdict(actor.stats)}
    del told["stats"], told["key_times"]
    return told | {"valid_share": actor.stats.valid_share, "match_share": actor.stats.match_share}
