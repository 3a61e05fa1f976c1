"""The independent audit compares acknowledged chunks with the replay's files, and checks the tests.

It uses none of the replay's code for reading. It takes one number from the journal: how many steps
were stored. It walks through so many rows of the columns and recognises each chunk by the digest
that its actor recorded before sending it (`witness`). The tests are those in the learner's table.
"""

import csv
import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.chaos.witness import digest
from common.errors import InputError

FRAME = 84 * 84
MAX_CONTEXT = 3
"""Rows that the replay may store before a chunk whose predecessor is missing: older frames of its
first state."""
_Chunk = tuple[str, int, int]
"""Digest of a chunk, and its rows: one for each step, and one for each frame that cut a game."""


@dataclass(frozen=True)
class Audit:
    """Numbers of chunks; the last two are numbers of steps and rows."""

    made: int
    acknowledged: int
    stored: int
    lost: int
    """Chunks that were acknowledged but are not in the files as sent: they are gone or altered."""
    duplicated: int
    """Chunks that are stored more often than they were made."""
    steps: int
    """Steps of the stored chunks."""
    unknown_rows: int
    """Rows that belong neither to a chunk that an actor made nor to a chunk's context."""

    @property
    def clean(self) -> bool:
        return self.lost == self.duplicated == self.unknown_rows == 0


class RecordedTest(NamedTuple):
    """A test of an epoch's weights, as the learner recorded it."""

    epoch: int
    steps: int
    """Agent steps played."""
    ended: float
    """Time of its end, in seconds of the run."""


@dataclass(frozen=True)
class AuditOfTests:
    """Numbers of tests of epochs."""

    tested: int
    repeated: int
    """Tests of an epoch that already had a recorded test."""
    short: int
    """Tests with fewer steps than were asked for."""

    @property
    def clean(self) -> bool:
        return self.repeated == self.short == 0


def recorded_tests(epochs: Path) -> list[RecordedTest]:
    """Returns the tests in a table of epochs; none if there is no table yet."""
    if not epochs.exists():
        return []
    lines = epochs.read_text().split("\n")[:-1]  # text after the last newline is half a line
    return [
        RecordedTest(int(row["epoch"]), int(row["steps"]), float(row["total_time"]))
        for row in csv.DictReader(lines)
        if row["phase"] == "test"
    ]


def audit_tests(epochs: Path, steps: int) -> AuditOfTests:
    """Compares a table of epochs with what was asked for: one test of ``steps`` for each epoch."""
    tests = recorded_tests(epochs)
    return AuditOfTests(
        tested=len({test.epoch for test in tests}),
        repeated=len(tests) - len({test.epoch for test in tests}),
        short=sum(test.steps < steps for test in tests),
    )


def audit(replay: Path, records: Iterable[Path]) -> Audit:
    """Compares the ``records`` of all actors with the files in the folder ``replay``.

    Raises:
        InputError: the ring has wrapped, so it does not hold everything.
    """
    made, acknowledged = _recorded(records)
    shapes = Counter(chunk[1:] for chunk in made).most_common()
    capacity, head = _extent(replay / "journal.jsonl")
    if head > capacity:
        raise InputError(f"{head:,} steps do not fit into the replay: raise its --capacity.")
    columns: dict[str, NDArray[Any]] = {
        "frames": np.memmap(replay / "frames.bin", np.uint8, "r", shape=(capacity, FRAME)),
        "actions": np.memmap(replay / "actions.bin", np.uint8, "r"),
        "rewards": np.memmap(replay / "rewards.bin", np.float32, "r"),
        "elapsed": np.memmap(replay / "elapsed.bin", np.uint8, "r"),
    }

    def chunk_at(row: int) -> _Chunk | None:
        for (length, finals), _ in shapes:
            end = row + length
            steps = {name: column[row:end] for name, column in columns.items()}
            cut = columns["frames"][end : end + finals]
            found = digest(steps.__getitem__, cut), length, finals
            if end + finals <= head and found in made:
                return found
        return None

    stored: Counter[_Chunk] = Counter()
    row = unknown = skipped = 0
    while row < head:
        if (chunk := chunk_at(row)) is not None:
            stored[chunk] += 1
            row += chunk[1] + chunk[2]
            unknown += skipped if skipped > MAX_CONTEXT else 0
            skipped = 0
        else:
            row += 1
            skipped += 1
    return Audit(
        made=made.total(),
        acknowledged=acknowledged.total(),
        stored=stored.total(),
        lost=(acknowledged - stored).total(),
        duplicated=(stored - made).total(),
        steps=sum(length * count for (_, length, _), count in stored.items()),
        unknown_rows=unknown + skipped,
    )


def _recorded(records: Iterable[Path]) -> tuple[Counter[_Chunk], Counter[_Chunk]]:
    """Returns the chunks made and acknowledged."""
    found: dict[str, Counter[_Chunk]] = {"made": Counter(), "acknowledged": Counter()}
    for record in records:
        for line in record.read_text().split("\n")[:-1]:  # text after the last newline is half
            what, chunk, length, finals = line.split()
            found[what][chunk, int(length), int(finals)] += 1
    return found["made"], found["acknowledged"]


def _extent(journal: Path) -> tuple[int, int]:
    """Returns the replay's capacity, and the number of steps that were ever stored."""
    capacity = head = 0
    for line in journal.read_text().splitlines():
        entry = json.loads(line)
        capacity = entry.get("capacity", capacity)
        if entry["kind"] == "state":
            head = entry["head"]
        elif entry["kind"] == "chunk":
            base, context, steps, finals, *_ = entry["placement"]
            head = base + context + steps + finals
    return capacity, head
