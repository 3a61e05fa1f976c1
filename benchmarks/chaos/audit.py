"""The independent audit: what actors were told is stored, beside what the replay's files hold.

It uses nothing of the replay's own reading. Of the journal it takes one number, how many steps were
stored; it walks through so many rows of the columns and recognises each chunk by the digest that
its actor recorded before sending it (`witness`).
"""

import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.chaos.witness import digest
from common.errors import InputError

FRAME = 84 * 84
MOST_CONTEXT = 3
"""Rows that the replay may store before a chunk whose predecessor is missing: older frames of its
first state."""


@dataclass(frozen=True)
class Audit:
    """Numbers of chunks, but for the last two, of steps."""

    made: int
    acknowledged: int
    stored: int
    lost: int
    """Acknowledged, and not in the files as they were sent: gone, or altered."""
    duplicated: int
    """Stored more often than made."""
    steps: int
    """Steps of the chunks that are stored."""
    unknown_rows: int
    """Steps of no chunk that an actor made, nor the context of one."""

    @property
    def clean(self) -> bool:
        return self.lost == self.duplicated == self.unknown_rows == 0


def audit(replay: Path, records: Iterable[Path]) -> Audit:
    """Compares the ``records`` of all actors with the files in the folder ``replay``.

    Raises:
        InputError: the ring has wrapped, so it cannot have everything.
    """
    made, acknowledged, lengths = _recorded(records)
    capacity, head = _extent(replay / "journal.jsonl")
    if head > capacity:
        raise InputError(f"{head:,} steps do not fit into the replay: raise its --capacity.")
    columns: dict[str, NDArray[Any]] = {
        "frames": np.memmap(replay / "frames.bin", np.uint8, "r", shape=(capacity, FRAME)),
        "actions": np.memmap(replay / "actions.bin", np.uint8, "r"),
        "rewards": np.memmap(replay / "rewards.bin", np.float32, "r"),
        "elapsed": np.memmap(replay / "elapsed.bin", np.uint8, "r"),
    }

    def chunk_at(row: int) -> tuple[str, int] | None:
        for length in lengths:
            steps = {name: column[row : row + length] for name, column in columns.items()}
            found = digest(steps.__getitem__), length
            if row + length <= head and found in made:
                return found
        return None

    stored: Counter[tuple[str, int]] = Counter()
    row = unknown = skipped = 0
    while row < head:
        if (chunk := chunk_at(row)) is not None:
            stored[chunk] += 1
            row += chunk[1]
            unknown += skipped if skipped > MOST_CONTEXT else 0
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
        steps=sum(length * count for (_, length), count in stored.items()),
        unknown_rows=unknown + skipped,
    )


def _recorded(
    records: Iterable[Path],
) -> tuple[Counter[tuple[str, int]], Counter[tuple[str, int]], list[int]]:
    """Returns the chunks made and acknowledged, and their lengths, the most frequent first."""
    found: dict[str, Counter[tuple[str, int]]] = {"made": Counter(), "acknowledged": Counter()}
    lengths: Counter[int] = Counter()
    for record in records:
        for line in record.read_text().split("\n")[:-1]:  # what follows the last newline is torn
            what, chunk, length = line.split()
            found[what][chunk, int(length)] += 1
            lengths[int(length)] += 1
    return found["made"], found["acknowledged"], [length for length, _ in lengths.most_common()]


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
