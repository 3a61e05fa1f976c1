"""The table of figures in the form of Prometheus: names, types, units and help.

A name is ``ale_robot_<group>_<name>_<unit>``, in base units; the name of a counter ends in
``_total``. Texts, such as the game, are labels of ``ale_robot_run_info``. A figure whose value is
unknown has no sample.
"""

from collections.abc import Callable, Iterable, Iterator

from prometheus_client import CollectorRegistry, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily
from prometheus_client.exposition import CONTENT_TYPE_LATEST
from prometheus_client.metrics_core import Metric as Family
from prometheus_client.registry import Collector

from common.metrics import METRICS, Metric, Value, Values
from common.process.http_page import Page

PREFIX = "ale_robot"
INFO = f"{PREFIX}_run_info"
_UNITS = {"milliseconds": ("seconds", 1_000)}
"""Base unit of each unit, and how many of that unit make one of it."""
_WITHOUT = {"none", "per second", "per day"}
"""Units that are not appended to names."""


def exposed_name(metric: Metric) -> str:
    """Returns the name under which Prometheus stores a numeric figure."""
    words = [PREFIX, *metric.key.replace("/", "_").split("_")]
    unit, _ = _UNITS.get(metric.unit, (metric.unit, 1))
    if metric.unit not in _WITHOUT and not {unit, unit.removesuffix("s")} & {*words}:
        words += unit.split()
    return "_".join([*words, "total"] if metric.counter else words)


def family(
    metric: Metric, samples: Iterable[tuple[tuple[str, ...], Value]], *labels: str
) -> Family:
    """Returns a figure with its ``samples``, each of which has the labels' values and its own."""
    unit, factor = _UNITS.get(metric.unit, (metric.unit, 1))
    help_text = metric.meaning + ("" if unit == "none" else f" ({unit})")
    kind = CounterMetricFamily if metric.counter else GaugeMetricFamily
    found = kind(exposed_name(metric), help_text, labels=labels)
    for of, value in samples:
        if value is not None and not isinstance(value, str):
            found.add_metric(of, value / factor)
    return found


def families(values: Values) -> Iterator[Family]:
    """Yields every numeric figure of the table, and one info metric of all texts in ``values``."""
    for metric in METRICS.values():
        if metric.form != "text":
            yield family(metric, [((), values.get(metric.key))])
    texts = {
        key.replace("/", "_").removeprefix("run_"): str(value)
        for key, value in values.items()
        if METRICS[key].form == "text" and value is not None
    }
    yield InfoMetricFamily(INFO.removesuffix("_info"), "The run, in words", texts)


def metrics_page(collect: Callable[[], Iterable[Family]]) -> Callable[[], Page]:
    """Returns the page ``/metrics`` of a process whose figures ``collect`` returns."""

    class Figures(Collector):
        def collect(self) -> Iterable[Family]:
            return collect()

    registry = CollectorRegistry()
    registry.register(Figures())
    ProcessCollector(registry=registry)
    return lambda: Page(generate_latest(registry), CONTENT_TYPE_LATEST)
