"""Weights on disk: those of the best test, and those of each epoch, until its test or for good."""

import json
from pathlib import Path
from typing import Any

from common.atomic_file import write_atomically, write_json
from common.checked import Count, FromOne, Score, build
from common.crc32 import crc32
from common.regular_file import read_file
from common.run.folder import epoch_name, kept_networks

_EPOCH, _CHECKSUM = "epoch", "crc32"
"""Keys of the card of the best weights."""
_UNREADABLE = (OSError, ValueError, TypeError, KeyError, RecursionError)
"""Errors of a card that is missing or broken."""


class UnusableSnapshot(Exception):
    """Weights that are missing, or not those that were stored. Its text says which."""


class Snapshots:
    """The folder ``snapshots/`` of a run.

    Args:
        keep: whether each epoch's weights stay after its test.
    """

    def __init__(self, folder: Path, *, keep: bool = False) -> None:
        self._folder = folder
        self.keep = keep
        self.best = folder / "best.safetensors"
        """The weights of the best test."""
        self.best_card = folder / "best.json"
        """What is known of that test."""

    def write(self, epoch: int, weights: bytes) -> None:
        """Stores the weights of an epoch until `remove`."""
        self._folder.mkdir(parents=True, exist_ok=True)
        write_atomically(self.file(epoch), weights)

    def read(self, epoch: int, checksum: int | None) -> bytes:
        """Returns the weights of an epoch.

        Args:
            checksum: CRC-32 of the weights, None if it is not known.

        Raises:
            UnusableSnapshot: they are missing or damaged.
            OSError: they cannot be read now.
        """
        try:
            weights = read_file(self.file(epoch))
        except FileNotFoundError:
            raise UnusableSnapshot("is missing") from None
        if checksum not in (None, crc32(weights)):
            raise UnusableSnapshot("is damaged")
        return weights

    def epochs(self) -> set[int]:
        """Returns the epochs whose weights are stored."""
        return set(kept_networks(self._folder))

    def remove(self, epoch: int) -> None:
        """Deletes the weights of an epoch, unless all are kept."""
        if not self.keep:
            self.file(epoch).unlink(missing_ok=True)

    def keep_as_best(self, epoch: int, weights: bytes, card: dict[str, Any]) -> None:
        """Makes an epoch's ``weights`` `best`, and writes ``card`` beside them.

        The card comes first, and decides: if a kill or a full disk prevents the copy, `finish_best`
        makes it.
        """
        write_json(self.best_card, card | {_EPOCH: epoch, _CHECKSUM: crc32(weights)})
        write_atomically(self.best, weights)

    def finish_best(self, only: int | None = None) -> bool:
        """Makes the copy of the best weights that a kill or a full disk prevented; if ``only`` is
        given, only of that epoch. Returns False if its weights are stored, but cannot be read now.
        """
        try:
            card = json.loads(read_file(self.best_card))
            epoch, checksum = build(FromOne, card[_EPOCH]), build(Count, card[_CHECKSUM])
        except _UNREADABLE:
            return True  # nothing is known of it
        if only not in (None, epoch):
            return True
        try:
            weights = self.read(epoch, checksum)
        except UnusableSnapshot:
            return True  # its epoch's weights are gone: the copy was made
        except OSError:
            return False
        write_atomically(self.best, weights)
        return True

    def best_score(self) -> float | None:
        """Returns the mean score of `best`; None if its card is missing or broken."""
        try:
            return build(Score, json.loads(read_file(self.best_card))["mean_score"])
        except _UNREADABLE:
            return None

    def file(self, epoch: int) -> Path:
        """Returns the path of an epoch's weights, which need not exist."""
        return self._folder / f"{epoch_name(epoch)}.safetensors"
