"""``epochs.csv``: one row per phase of an epoch, in the columns of 2017.

The file is the run's record of what was reached and how fast, and can be laid over the results
of the first experiment without conversion. Times are wall clock, where those of 2017 were CPU
time.
"""

import csv
import dataclasses
import io
import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self, get_args, get_type_hints

from common.errors import InputError
from common.run.folder import write_atomically

EpochPhase = Literal["random", "train", "test"]


@dataclass(frozen=True, kw_only=True)
class EpochRow:
    """One phase of one epoch; its fields, in order, are the columns."""

    epoch: int
    """0 for the warm-up, then 1, 2, 3 …"""
    phase: EpochPhase
    """``random`` is a warm-up in which all actions were."""
    steps: int
    """Agent steps in this phase."""
    nr_games: int
    """Games that ended in it."""
    average_reward: float | None
    """Mean score of those games; None, an empty cell, without any."""
    min_game_reward: float | None
    max_game_reward: float | None
    last_exploration_rate: float
    total_train_steps: int
    """Training steps so far, the random ones not included."""
    replay_memory_count: int
    meanq: float | None
    """Mean max-Q over the held-out states, with the weights of the phase's end."""
    meancost: float | None
    """Mean loss over the phase's updates."""
    weight_updates: int
    total_time: float
    """Seconds of the run until the phase's end."""
    epoch_time: float
    """Seconds of this phase."""
    steps_per_second: float

    @classmethod
    def of_games(
        cls, scores: Sequence[float], *, steps: int, epoch_time: float, **columns: Any
    ) -> Self:
        """The row of a phase in which games with these scores ended.

        Args:
            columns: those that do not follow from the scores, steps and time.
        """
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
_HINTS = get_type_hints(EpochRow)


class EpochTable:
    """The rows of one run, in a CSV file that only grows, but for a resume."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def append(self, row: EpochRow) -> None:
        """Add ``row``; it is on the disk when this returns."""
        if not self._path.exists():
            write_atomically(self._path, _text([COLUMNS, _cells(row)]))
            return
        with open(self._path, "ab") as file:
            file.write(_text([_cells(row)]))
            file.flush()
            os.fsync(file.fileno())

    def rows(self) -> list[EpochRow]:
        """All rows; none where there is no file yet.

        Raises:
            InputError: the file is not what `append` writes.
        """
        lines = self._lines()
        return [self._row(number, line) for number, line in enumerate(lines, 1)]

    def keep(self, count: int) -> list[EpochRow]:
        """Drop the rows after the first ``count``, atomically, and return those that stay.

        For a resume: a checkpoint knows how many rows there were, and what follows it (perhaps
        torn by the crash) will be written again.

        Raises:
            InputError: there are fewer rows, or one of them is damaged.
        """
        lines = self._lines()
        if len(lines) < count:
            raise InputError(
                f"{self._path} has {len(lines)} rows where the checkpoint knows of {count}: "
                "put the missing ones back, or start a new run."
            )
        kept = [self._row(number, line) for number, line in enumerate(lines[:count], 1)]
        if len(lines) > count:
            write_atomically(self._path, _text([COLUMNS, *map(_cells, kept)]))
        return kept

    def _lines(self) -> list[str]:
        """The lines after the header, with their ends."""
        try:
            text = self._path.read_bytes().decode("utf-8")
        except FileNotFoundError:
            return []
        except UnicodeDecodeError:
            raise self._damage("it is not text") from None
        except OSError as error:
            raise InputError(f"cannot read {self._path}: {error.strerror}.") from None
        header, *lines = text.splitlines(keepends=True) or [""]
        if not header.endswith("\n") or next(csv.reader([header])) != [*COLUMNS]:
            raise self._damage("its first line does not name the columns")
        return lines

    def _row(self, number: int, line: str) -> EpochRow:
        if not line.endswith("\n"):
            raise self._damage(f"row {number} is not whole")
        (cells,) = csv.reader([line])
        if len(cells) != len(COLUMNS):
            raise self._damage(f"row {number} has {len(cells)} cells instead of {len(COLUMNS)}")
        values: dict[str, Any] = {}
        for name, cell in zip(COLUMNS, cells, strict=True):
            try:
                values[name] = _value(_HINTS[name], cell)
            except ValueError:
                raise self._damage(f"row {number} has {cell!r} as its {name}") from None
        return EpochRow(**values)

    def _damage(self, what: str) -> InputError:
        return InputError(f"{self._path} is damaged ({what}): mend it, or start a new run.")


def _text(rows: Iterable[Iterable[Any]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


def _cells(row: EpochRow) -> list[Any]:
    # -21, as in 2017, not -21.0
    return [
        int(value)
        if isinstance(value, float) and value.is_integer() and abs(value) < 2**53
        else value
        for value in (getattr(row, name) for name in COLUMNS)
    ]


def _value(hint: Any, cell: str) -> Any:
    if hint is int:
        if not cell.isdecimal():
            raise ValueError(cell)
        return int(cell)
    if hint == EpochPhase:
        if cell not in get_args(EpochPhase):
            raise ValueError(cell)
        return cell
    if cell == "" and hint == float | None:
        return None
    return float(cell)
