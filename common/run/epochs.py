"""``epochs.csv``: one row per phase of an epoch, in the columns of 2017.

The file records what the run reached and how fast, and can be compared with the results of the
first experiment without conversion. Times are wall-clock times; those of 2017 were CPU times.
"""

import csv
import dataclasses
import io
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AllowInfNan

from common.atomic_file import append_whole, write_atomically
from common.checked import Count, Invalid, build
from common.errors import InputError, cannot_read
from common.regular_file import read_file

EpochPhase = Literal["random", "train", "test"]
Figure = Annotated[float, AllowInfNan(True)]
"""A number that a diverged learner may have made infinite or NaN."""


@dataclass(frozen=True, kw_only=True)
class EpochRow:
    """One phase of one epoch; its fields, in order, are the columns."""

    epoch: Count
    """0 for the warm-up, then 1, 2, 3 …"""
    phase: EpochPhase
    """``random`` is a warm-up in which all actions were random, except those of demonstrations."""
    steps: Count
    """Agent steps in this phase."""
    nr_games: Count
    """Games that ended in it."""
    average_reward: Figure | None
    """Mean score of those games; None, an empty cell, if there were none."""
    min_game_reward: Figure | None
    """Lowest of those scores."""
    max_game_reward: Figure | None
    """Highest of those scores."""
    last_exploration_rate: Figure
    """Share of random actions at the phase's end."""
    total_train_steps: Count
    """Training steps so far, without the random ones."""
    replay_memory_count: Count
    """Steps in the replay."""
    meanq: Figure | None
    """Mean max-Q over the held-out states, with the weights at the phase's end."""
    meancost: Figure | None
    """Mean loss over the phase's updates."""
    weight_updates: Count
    """Updates of the network so far."""
    total_time: Figure
    """Seconds of the run until the phase's end."""
    epoch_time: Figure
    """Seconds of this phase."""
    steps_per_second: Figure
    """Agent steps per second of this phase."""

    def agent_steps(self, learning_starts: int) -> int:
        """Returns the agent steps of the run until the phase's end, or until that of the tested
        epoch. A recording may make the warm-up longer than ``learning_starts``."""
        return self.total_train_steps + learning_starts if self.epoch else self.steps

    @classmethod
    def of_games(
        cls, scores: Sequence[float], *, steps: int, epoch_time: float, **columns: Any
    ) -> Self:
        """Returns the row of a phase in which games with these ``scores`` ended. ``columns`` are
        those that do not follow from scores, steps and time."""
        return cls(
            steps=steps,
            nr_games=len(scores),
            average_reward=math.fsum(scores) / len(scores) if scores else None,
            min_game_reward=min(scores, default=None),
            max_game_reward=max(scores, default=None),
            epoch_time=epoch_time,
            steps_per_second=steps / epoch_time if epoch_time > 0 else 0.0,
            **columns,
        )


COLUMNS = tuple(field.name for field in dataclasses.fields(EpochRow))
_HEADER = ",".join(COLUMNS) + "\n"


class EpochTable:
    """The rows of one run, in a CSV file that only grows, except when the run is resumed."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def append(self, row: EpochRow) -> None:
        """Adds ``row``; it is on the disk when this returns."""
        if not self._path.exists():
            write_atomically(self._path, _HEADER.encode())
        line = io.StringIO()
        csv.writer(line, lineterminator="\n").writerow(map(_cell, dataclasses.astuple(row)))
        append_whole(self._path, line.getvalue().encode(), durable=True)

    def rows(self) -> list[EpochRow]:
        """Returns all rows, or none if there is no file yet. Raises InputError if `append` did not
        write the file."""
        return self._rows(self._lines())

    def keep(self, count: int) -> list[EpochRow]:
        """Drops the rows after the first ``count``, atomically, and returns those that stay.

        A resume calls this: the checkpoint knows how many rows there were, and the run writes later
        rows, of which a crash may have torn one, again. Raises InputError if there are fewer rows,
        or one of them is damaged.
        """
        lines = self._lines()
        if len(lines) < count:
            raise InputError(
                f"{self._path} has {len(lines)} rows where the checkpoint knows of {count}: "
                "put the missing ones back, or start a new run."
            )
        rows = self._rows(lines[:count])
        if len(lines) > count:
            write_atomically(self._path, "".join([_HEADER, *lines[:count]]).encode())
        return rows

    def _lines(self) -> list[str]:
        """Returns the lines after the header, with their line ends."""
        try:
            text = io.TextIOWrapper(io.BytesIO(read_file(self._path)), "utf-8").read()
            header, *lines = text.splitlines(keepends=True) or [""]
        except FileNotFoundError:
            return []
        except UnicodeDecodeError:
            raise self._damage("it is not text") from None
        except OSError as error:
            raise cannot_read(self._path, error) from None
        if header != _HEADER:
            what = "name a run's folder or its epochs.csv, or put that line back"
            if self._path.suffix == ".json":
                what = "add --figure histogram if it is an evaluation, or name a run's folder"
            raise InputError(
                f"{self._path} is not a table of epochs, because its first line does not name the "
                f"columns: {what}."
            )
        return lines

    def _rows(self, lines: Sequence[str]) -> list[EpochRow]:
        rows = []
        for number, line in enumerate(lines, 1):
            try:
                cells = next(csv.reader([line]))
            except csv.Error as error:  # such as a cell without end
                raise self._damage(f"row {number}: {error}") from None
            if not line.endswith("\n") or len(cells) != len(COLUMNS):
                raise self._damage(f"row {number} is not whole")
            values = dict(zip(COLUMNS, map(_value, cells), strict=True))
            try:
                rows.append(build(EpochRow, values, f"row {number}"))
            except Invalid as error:
                raise self._damage(str(error)) from None
        return rows

    def _damage(self, what: str) -> InputError:
        return InputError(f"{self._path} is damaged ({what}): repair it, or start a new run.")


def epochs_per_day(
    epoch_steps: int, test_steps: int, train_rate: float | None, test_rate: float | None
) -> float | None:
    """Returns how many epochs fit in a day at these rates, in steps per second.

    It counts training and then testing, one after the other as in 2017, so that the figure can be
    compared with that experiment's 40 (ALE-Only) and 2 to 4 (ALE-Robot) epochs a day. Here
    evaluators play during training, so if both rates were measured side by side, a run makes at
    least as many epochs. None if a needed rate is unknown or 0.
    """
    seconds = 0.0
    for steps, rate in ((epoch_steps, train_rate), (test_steps, test_rate)):
        if steps and not rate:
            return None
        seconds += steps / rate if rate else 0.0
    return 86_400 / seconds if seconds else None


def _cell(value: Any) -> Any:
    """Returns ``value``, a whole number without its fraction: -21, as in 2017, not -21.0."""
    whole = isinstance(value, float) and value.is_integer() and abs(value) < 2**53
    return int(value) if whole else value


def _value(cell: str) -> int | float | str | None:
    for kind in (int, float):
        with suppress(ValueError):
            return kind(cell)
    return cell or None
