"""Weights on disk: of each epoch that is still to be tested, and of the best test so far."""

import json
from pathlib import Path
from typing import Any

from common.run.folder import write_atomically


class Snapshots:
    """The folder ``snapshots/`` of a run."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def write(self, epoch: int, weights: bytes) -> None:
        """Keep the weights of an epoch until `remove` or `keep_as_best`."""
        self._folder.mkdir(parents=True, exist_ok=True)
        write_atomically(self._file(epoch), weights)

    def read(self, epoch: int) -> bytes:
        return self._file(epoch).read_bytes()

    def has(self, epoch: int) -> bool:
        """Whether the weights of an epoch are there."""
        return self._file(epoch).is_file()

    def remove(self, epoch: int) -> None:
        self._file(epoch).unlink(missing_ok=True)

    def keep_as_best(self, epoch: int, card: dict[str, Any]) -> None:
        """Let an epoch's weights be ``best.safetensors``, and ``card`` say what they are."""
        self._file(epoch).replace(self._folder / "best.safetensors")
        write_atomically(self._folder / "best.json", json.dumps(card, indent=2).encode())

    def _file(self, epoch: int) -> Path:
        return self._folder / f"epoch-{epoch:04d}.safetensors"
