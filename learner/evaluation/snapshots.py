"""Weights on disk: of the best test so far, and of each epoch until it is tested or for good."""

import json
from pathlib import Path
from typing import Any

from common.regular_file import read_file
from common.run.folder import epoch_name, write_atomically


class Snapshots:
    """The folder ``snapshots/`` of a run.

    Args:
        keep: whether each epoch's weights stay.
    """

    def __init__(self, folder: Path, *, keep: bool = False) -> None:
        self._folder = folder
        self.keep = keep

    def write(self, epoch: int, weights: bytes) -> None:
        """Keep the weights of an epoch until `remove`."""
        self._folder.mkdir(parents=True, exist_ok=True)
        write_atomically(self.file(epoch), weights)

    def read(self, epoch: int) -> bytes:
        """Returns the weights of an epoch. Raises OSError if they are not there."""
        return read_file(self.file(epoch))

    def remove(self, epoch: int) -> None:
        """Delete the weights of an epoch, unless all are kept."""
        if not self.keep:
            self.file(epoch).unlink(missing_ok=True)

    def keep_as_best(self, epoch: int, card: dict[str, Any]) -> None:
        """Let an epoch's weights be ``best.safetensors``, and ``card`` say what they are."""
        write_atomically(self._folder / "best.safetensors", self.read(epoch))
        write_atomically(self._folder / "best.json", json.dumps(card, indent=2).encode())

    def best_score(self) -> float | None:
        """The mean score of ``best.safetensors``; None if there is none, or no card that says."""
        try:
            return float(json.loads(read_file(self._folder / "best.json"))["mean_score"])
        except (OSError, ValueError, TypeError, KeyError):
            return None

    def file(self, epoch: int) -> Path:
        """Returns where the weights of an epoch are, or would be."""
        return self._folder / f"{epoch_name(epoch)}.safetensors"
