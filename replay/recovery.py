"""Restores a replay from its files: the chunk index from the journal, and the links between the
chunks in the ring. What is damaged is reported, and the rest is used."""

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.errors import InputError
from common.process.progress import Progress
from common.settings.config import RunConfig
from replay.chunk_index import ChunkIndex
from replay.damage import damaged
from replay.journal import Entry, read_journal
from replay.ring import Ring

FORMAT = 2
_READ_FORMATS = (1, FORMAT)
"""Formats that can be read; format 1 had no checksums."""
_log = logging.getLogger(__name__)


def header_of(config: RunConfig) -> Entry:
    """Returns the first entry of a run's journal, without the identity of its ring."""
    return {
        "kind": "ring",
        "format": FORMAT,
        "capacity": config.replay.capacity,
        "history": config.play.frame_stack,  # its name in journals since format 1
        "vector_width": config.vector_width,
    }


def read_index(path: Path, config: RunConfig) -> tuple[ChunkIndex, str | None]:
    """Returns the index in the journal at ``path``, empty if there is none, and the identity of its
    ring, None if it has none yet.

    Raises:
        InputError: the ring has other sizes than ``config``, or lines without which nothing can be
            read are damaged.
    """
    index, entries = ChunkIndex(), read_journal(path)
    if not path.exists():
        return index, None
    header, *rest = entries or [None]
    if header is None:
        raise damaged(path, "in line 1")
    if header.get("format") in _READ_FORMATS:
        header["format"] = FORMAT
    if unequal := [
        f"{name} {header.get(name)} instead of {value}"
        for name, value in header_of(config).items()
        if header.get(name) != value
    ]:
        raise InputError(
            f"the replay in {path.parent} has {', '.join(unequal)}: resume it with the "
            "settings it was made with, or name another run."
        )
    lost = []
    for number, entry in enumerate(rest, start=2):
        try:
            index.apply(entry or {})
        except (KeyError, TypeError, ValueError):
            if number == 2:  # it holds all counters
                raise damaged(path, "in line 2") from None
            lost.append(number)
    if lost:
        text = (
            "%d of %d lines of %s are damaged, the first is line %d: their chunks are lost, "
            "the rest is used"
        )
        _log.warning(text, len(lost), len(entries), path, lost[0])
    if (cut := index.unlisted - len(lost)) > 0:
        text = "%s was cut short: at least %d chunks that it listed are lost, the rest is used"
        _log.warning(text, path, cut)
    # In case the line that evicts them was lost.
    index.evict(max(index.tail, index.head - config.replay.capacity))
    identity = header.get("uuid")
    return index, None if identity is None else str(identity)


def restore(ring: Ring, index: ChunkIndex, folder: Path) -> NDArray[np.int64]:
    """Links the undamaged chunks of ``index`` in ``ring``, whose files are in ``folder``, and drops
    the others; returns the sampleable steps."""
    kept, lost = len(index.chunks), []
    # The progress is shown because all rows are read, from a disk that may be slow.
    with Progress("checking the replay", kept) as progress:
        for number, (key, place) in enumerate(index.chunks.items(), 1):
            if not ring.is_whole(place):
                lost.append(key)
            progress.update(number, note=f"{number:,} of {kept:,} chunks")
    for key in lost:
        index.drop(key)
    if lost:
        text = (
            "%d of %d chunks in %s are damaged, or were overwritten while they were copied: "
            "they are not drawn, the rest is used"
        )
        _log.warning(text, len(lost), kept, folder)
    ring.tail, ring.head = index.tail, index.head
    for key, place in index.chunks.items():
        ring.link(place)
        if place.previous >= 0 and key.beside(-1) not in index.chunks:
            ring.cut(place)
    for key, place in index.chunks.items():
        if (after := index.chunks.get(key.beside(1))) is not None:
            ring.join(place, after)
    alive = np.arange(ring.tail, ring.head)
    return alive[ring.is_complete(alive)]
