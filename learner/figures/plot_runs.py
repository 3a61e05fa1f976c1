"""Figures of runs: reward and max-Q by epoch, and reward by agent steps and by wall clock."""

import json
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from operator import attrgetter
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from common.errors import InputError, cannot_read
from common.regular_file import read_file
from common.run.epochs import EpochRow, EpochTable
from common.run.folder import CONFIG, EPOCHS, INITIAL, SUMMARY, RunFolder
from common.settings.clock import ClockConfig
from learner.figures.plot_style import (
    Points,
    Series,
    draw_random,
    draw_series,
    label,
    legend,
    panels,
)

Phase = Literal["test", "train"]
_SEED = re.compile(r"[-_]?(seed)?[-_]?\d+$")
_MODE = tuple(field.name for field in fields(ClockConfig))
"""Figures in ``summary.json`` that tell how time passed in local mode, unlike the configuration."""


@dataclass(frozen=True)
class Run:
    """One run's table of epochs."""

    name: str
    rows: list[EpochRow]
    settings: str | None
    """All settings but the seed; None for a CSV file alone, whose settings are unknown."""
    phase: Phase
    """Phase of each epoch whose rewards are drawn."""

    @property
    def random(self) -> float | None:
        """Mean reward of the random policy in the warm-up."""
        return next((r.average_reward for r in self.rows if r.phase == "random"), None)

    def rewards(self, x: Callable[[EpochRow], float]) -> Points:
        """Returns the mean reward of each epoch's games, by ``x``."""
        return self._points(self.phase, x, lambda row: row.average_reward)

    def max_q(self, x: Callable[[EpochRow], float]) -> Points:
        """Returns the mean max-Q over the held-out states after each epoch's training, by ``x``."""
        return self._points("train", x, lambda row: row.meanq)

    def _points(
        self, phase: str, x: Callable[[EpochRow], float], y: Callable[[EpochRow], float | None]
    ) -> Points:
        found = [(x(row), y(row)) for row in self.rows if row.phase == phase]
        points = np.array([pair for pair in found if pair[1] is not None], np.float64)
        points = points.reshape(-1, 2)
        return points[np.argsort(points[:, 0], kind="stable")]


class Group(NamedTuple):
    """Runs that differ only in the seed."""

    name: str
    runs: list[Run]


def read_groups(paths: Sequence[Path], phase: Phase = "test") -> list[Group]:
    """Returns the runs at ``paths``, folders or CSV files, grouped by their settings.

    CSV files alone belong together if their names differ only in a seed's number at the end. A run
    without tests is drawn with the rewards of its training.

    Raises:
        InputError: a table is missing or damaged, or has no epoch yet.
    """
    groups: dict[str, list[Run]] = {}
    for path in paths:
        run = _read(path, phase)
        alone = _SEED.sub("", run.name) if "seed" in run.name else str(path.resolve())
        groups.setdefault(run.settings or f"table {alone}", []).append(run)
    return [Group(_name([run.name for run in runs]), runs) for runs in groups.values()]


def _read(path: Path, phase: Phase) -> Run:
    table = path / EPOCHS if path.is_dir() else path
    if not table.exists() and RunFolder.at(path) is None:
        raise InputError(f"{path} holds no run: name a run's folder or a results file.")
    rows = EpochTable(table).rows()
    if not any(row.phase != "random" for row in rows):
        raise InputError(
            f"{table} has no complete epoch yet{_how_far(path)}: let the run go on, and see its "
            "curves meanwhile with TensorBoard or on the page of --web."
        )
    name = path.resolve().name if path.is_dir() else path.stem
    tested = any(row.phase == "test" for row in rows)
    settings = _settings(path) if path.is_dir() else None
    return Run(name, rows, settings, phase if tested else "train")


def _how_far(path: Path) -> str:
    """Returns how far the run in the folder ``path`` is on its way to the end of its first epoch;
    nothing if that is unknown, as for a CSV file alone."""
    with suppress(InputError):  # a copy may have a name that no run could have
        if (run := RunFolder.at(path)) is None or (config := run.stored_config()) is None:
            return ""
        steps = (_json(run.summary) or {}).get("agent_steps")
        if isinstance(steps, int):
            whole = config.replay.learning_starts + config.protocol.epoch_steps
            return f" ({steps:,} of {whole:,} steps)"
    return ""


def _settings(folder: Path) -> str | None:
    config = _json(folder / CONFIG)
    if config is None:
        return None
    config.pop("seed", None)
    summary = _json(folder / SUMMARY) or {}
    given = (folder / INITIAL).exists()
    return json.dumps([config, given, *(summary.get(name) for name in _MODE)], sort_keys=True)


def _json(path: Path) -> dict[str, Any] | None:
    try:
        found = json.loads(read_file(path))
        if not isinstance(found, dict):
            raise ValueError("it holds no table")
    except FileNotFoundError:
        return None
    except (OSError, ValueError, RecursionError) as error:
        raise cannot_read(path, error) from None
    return found


def _name(names: Sequence[str]) -> str:
    """Returns the name of a group: that of its runs, without the seed's number at the end."""
    return names[0] if len(names) == 1 else _SEED.sub("", names[0]) or names[0]


def epochs_figure(groups: Sequence[Group]) -> Figure:
    """Draws average reward and mean max-Q by epoch, as in the 2017 report's Figures 6 to 9."""
    figure, (rewards, values) = panels(2)
    epoch = attrgetter("epoch")
    draw_series(rewards, _series(groups, lambda run: run.rewards(epoch)))
    draw_series(values, _series(groups, lambda run: run.max_q(epoch)))
    draw_random(rewards, _random(groups))
    label(rewards, "epoch", _reward_name(groups))
    label(values, "epoch", "mean max-Q over held-out states")
    for axes in (rewards, values):
        axes.set_xlim(left=0)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    legend(figure)
    return figure


def progress_figure(groups: Sequence[Group]) -> Figure:
    """Draws average reward by agent steps and by wall clock, which includes the tests' time.

    Seeds are averaged by steps only.
    """
    rows = [row for group in groups for run in group.runs for row in run.rows]
    steps, steps_name = _scale(
        max(row.total_train_steps for row in rows),
        ((1e6, "millions"), (1e3, "thousands"), (1, "single")),
    )
    seconds, time_name = _scale(
        max(row.total_time for row in rows) / 1.5,
        ((86_400, "days"), (3_600, "hours"), (60, "minutes"), (1, "seconds")),
    )
    figure, (by_steps, by_time) = panels(2)
    by_steps.sharey(by_time)
    draw_series(
        by_steps, _series(groups, lambda run: run.rewards(lambda r: r.total_train_steps / steps))
    )
    by_clock = _series(groups, lambda run: run.rewards(lambda row: row.total_time / seconds))
    # Machines were busy with other things for different times, so a mean by wall clock is useless.
    draw_series(by_time, by_clock, means=False)
    for axes in (by_steps, by_time):
        draw_random(axes, _random(groups))
        axes.set_xlim(left=0)
    label(by_steps, f"agent steps of training ({steps_name})", _reward_name(groups))
    label(by_time, f"wall clock ({time_name})", "")
    legend(figure)
    return figure


def _series(groups: Sequence[Group], line: Callable[[Run], Points]) -> list[Series]:
    return [Series(group.name, [line(run) for run in group.runs]) for group in groups]


def _random(groups: Sequence[Group]) -> list[float]:
    return [run.random for group in groups for run in group.runs if run.random is not None]


def _reward_name(groups: Sequence[Group]) -> str:
    """Returns the label of the reward axis; tests and training may stand side by side."""
    phases = {run.phase for group in groups for run in group.runs}
    kind = " or ".join({"test": "tests", "train": "training"}[phase] for phase in sorted(phases))
    return f"average reward of a game ({kind})"


def _scale(largest: float, units: Sequence[tuple[float, str]]) -> tuple[float, str]:
    """Returns the largest unit that is not above ``largest``, with its name."""
    return next((unit for unit in units if largest >= unit[0]), units[-1])
