"""Room on the disk; without it the next checkpoint would end the run."""

import shutil
import threading
from collections.abc import Callable
from pathlib import Path

_ROOM = 2
"""Checkpoints for which there should be room; tables and snapshots are smaller."""
_POLL = 0.1


class DiskRoom:
    """Pauses training while the disk is full.

    Args:
        checkpoint: the newest, which tells how large the next will be.
        say: takes a sentence for people.
        stop: ends every wait.
    """

    def __init__(self, checkpoint: Path, say: Callable[[str], None], stop: threading.Event) -> None:
        self._checkpoint = checkpoint
        self._say = say
        self._stop = stop

    def wait(self) -> None:
        """Return once there is room; at once where there is."""
        needed = _ROOM * self._checkpoint.stat().st_size
        if self._free() >= needed:
            return
        self._say(
            f"WARNING: the disk of {self._checkpoint.parent} is full: training waits until "
            f"{-(-needed // 2**20)} MiB of it are free."
        )
        while self._free() < needed:
            if self._stop.wait(_POLL):
                return
        self._say("There is room on the disk again: training continues.")

    def _free(self) -> int:
        return shutil.disk_usage(self._checkpoint.parent).free
