"""`python -m docs.metrics`: writes docs/metrics.md, every figure of a run by its name.

Names, units and meanings are those of `common.metrics` and of the columns of ``epochs.csv``, from
which all sinks write, so the page cannot say anything else than the program does.
"""

from collections.abc import Iterator
from dataclasses import fields
from itertools import groupby
from pathlib import Path

from common.metrics import METRICS, Metric
from common.run.epochs import EpochRow
from common.settings.meanings import docstrings
from docs.settings import row

PAGE = Path(__file__).with_name("metrics.md")
_HEAD = """\
# Figures of a run

Written by `python -m docs.metrics` from `common/metrics.py`, `common/protocol/actor_stats.py` and
`common/run/epochs.py`; a test compares them. A figure's name is that of its curve in TensorBoard
and in the [trackers](watching.md#other-trackers), over agent steps. Prometheus has every number,
[by a name made of this one](operations.md#watch-a-run).

| column | what it tells |
| --- | --- |
| on the screen | label in the terminal and on the page |
| curve | whether it is drawn by its name |
| gates.csv | its column there, and the name of its curve after `gates/` |
| summary.json | its key there; a dot leads into an inner object |
| healthy | what a health check asks of it, and what a failure means |
"""
_COLUMNS = (
    "name",
    "unit",
    "meaning",
    "on the screen",
    "curve",
    "gates.csv",
    "summary.json",
    "healthy",
)
_EPOCHS = """\
## Curves with a point for each epoch

*PHASE* is `random` (the warm-up), `train` or `test`. A point lies at the agent steps of the weights
that played.

| name | unit | meaning |
| --- | --- | --- |
| `play/epoch_PHASE_reward` | points | Mean score of the phase's games |
| `play/epoch_PHASE_min` | points | Lowest score of a game |
| `play/epoch_PHASE_max` | points | Highest score of a game |
| `play/epoch_PHASE_steps_per_second` | per second | Agent steps per second in the phase |
| `learning/epoch_PHASE_mean_max_q` | none | Mean max-Q over the held-out states, at its end |
| `learning/epoch_train_loss` | none | Mean loss over the phase's updates |

## Histograms, pictures and films

| name | meaning |
| --- | --- |
| `learning/max_q` | Max-Q of the held-out states |
| `hands/press_ms` | Milliseconds until every key of a command is down |
| `hands/release_ms` | Milliseconds until every key of the previous command is up |
| `play/camera` | What an actor's camera sees, every five minutes; TensorBoard only |
| `play/film` | Film of random play, then of an epoch's network, with `--films SECONDS` |

## Columns of epochs.csv

A row is a phase of an epoch. An empty cell is not known.

| column | meaning |
| --- | --- |
"""


def page() -> str:
    """Returns the whole page in Markdown."""
    by_group = sorted(METRICS.values(), key=_group)
    tables = [line for group, found in groupby(by_group, _group) for line in _table(group, found)]
    meanings = docstrings(EpochRow)
    columns = [row(f"`{field.name}`", meanings[field.name]) for field in fields(EpochRow)]
    return "\n".join([_HEAD, *tables, _EPOCHS + "\n".join(columns), ""])


def _group(metric: Metric) -> str:
    return metric.key.partition("/")[0]


def _table(group: str, metrics: Iterator[Metric]) -> Iterator[str]:
    yield from (f"## {group.capitalize()}", "", row(*_COLUMNS), row(*["---"] * len(_COLUMNS)))
    for metric in metrics:
        bound = metric.bound
        yield row(
            f"`{metric.key}`",
            metric.unit,
            metric.meaning,
            metric.label.partition(" {")[0].removesuffix(", epoch"),
            "yes" if metric.curve else "",
            metric.gate and f"`{metric.gate}`",
            metric.summary and f"`{metric.summary}`",
            f"{bound}; else {bound.why}" if bound else "",
        )
    yield ""


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(f"wrote {PAGE}")
