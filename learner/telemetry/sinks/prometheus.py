"""The learner's pages for a monitoring system: health, readiness and figures over HTTP."""

from collections.abc import Callable, Iterator
from dataclasses import replace

from prometheus_client.metrics_core import Metric as Family

from common.exposition import families, family, metrics_page
from common.metrics import METRICS, Metric
from common.process.http_page import Page, verdict
from common.protocol.actor_stats import TOTALS
from learner.telemetry.health_checks import hanging, reasons
from learner.telemetry.sinks.sink import LatestSink
from learner.telemetry.snapshot import Snapshot

MAX_ACTOR_SERIES = 256
"""Maximum number of actors with series of their own: names come from outside, and a monitoring
system keeps series for months."""

# fmt: off
PER_ACTOR: tuple[Metric, ...] = (
    Metric("actor/alive", "none", "count", "Whether the process is there: 0 or 1"),
    Metric("actor/silent_for", "seconds", ".1", "Time since the process was last heard of"),
    Metric("actor/steps_per_second", "per second", ".1", "Agent steps per second, of late"),
    Metric("actor/epsilon", "ratio", ".3", "Share of random actions"),
    Metric("actor/weights_version", "updates", "count", "Updates that made its weights"),
    Metric("actor/throttled_share", "ratio", ".3",
           "Share of the last ten seconds it paused because the learner was behind"),
    *(replace(METRICS[total], key=f"actor/{name}") for name, total in TOTALS.items()),
)
# fmt: on
"""Figures of one actor or evaluator since the start of its process, named after its fields."""
OMITTED = Metric("actors/omitted", "processes", "count", "Actors without series of their own")
CHECK = Metric("gates/red", "none", "count", "Whether a health check is red: 0 or 1")


class PrometheusSink(LatestSink):
    """Answers a monitoring system."""

    def pages(self) -> dict[str, Callable[[], Page]]:
        """Returns the pages by path, as `http_endpoints` takes them."""
        return {
            "/healthz": lambda: verdict(hanging(self._silent_for())),
            "/readyz": lambda: verdict(self._not_ready()),
            "/metrics": metrics_page(self.collect),
        }

    def _not_ready(self) -> list[str]:
        if self._latest is None:
            return ["the learner is starting"]
        return reasons(self._silent_for(), self._latest.checks)

    def collect(self) -> Iterator[Family]:
        """Yields all figures; before the first snapshot, those of the run have no samples."""
        latest = self._latest or Snapshot(values={})
        yield from families(latest.values)
        checks = [
            ((check.name, str(check.stops).lower()), int(not check.passed))
            for check in latest.checks
            if check.passed is not None
        ]
        yield family(CHECK, checks, "check", "stops")
        actors = sorted(latest.present, key=lambda actor: (not actor.alive, actor.silent_for))
        yield family(OMITTED, [((), max(len(actors) - MAX_ACTOR_SERIES, 0))])
        told = [
            ((actor.stats.name, actor.stats.role), vars(actor.stats) | vars(actor))
            for actor in actors[:MAX_ACTOR_SERIES]
        ]
        for metric in PER_ACTOR:
            name = metric.key.removeprefix("actor/")
            yield family(metric, [(of, each[name]) for of, each in told], "actor", "role")
