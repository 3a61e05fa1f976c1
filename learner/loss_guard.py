"""`LossGuard`: tells a diverged network, which ends the run, from a few bad minibatches."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from common.errors import InputError
from learner.algorithm.interface import Algorithm, Update
from replay.interface import Replay

_MAX_SKIPPED = 10
_RECENTLY = 100
"""If `_MAX_SKIPPED` of the `_RECENTLY` latest updates have a non-finite loss, the network is at
fault, not the minibatches."""


@dataclass
class LossGuard:
    """Quarantines the steps of minibatches with a non-finite loss, and notices divergence."""

    algorithm: Algorithm
    replay: Replay
    checkpoint: Path
    """File of the last good network, which an error names."""
    note: Callable[[str], None]
    """Takes an event for people."""

    def __post_init__(self) -> None:
        self.skipped = 0
        """Updates of this process whose loss was not finite."""
        self._diverged_at: int | None = None
        """Number of the first update that is the network's fault."""
        self._last_skipped: deque[int] = deque(maxlen=_MAX_SKIPPED)
        self._unseen: list[tuple[int, NDArray[np.int64], Update]] = []
        """Number, ids and result of each update whose loss has not been looked at yet."""

    def add(self, number: int, ids: NDArray[np.int64], result: Update) -> None:
        """Takes an update of the steps ``ids int64 [batch]``, without waiting for the device."""
        self._unseen.append((number, ids, result))

    def check(self) -> None:
        """Looks at all losses since the last call. Raises InputError if the network diverged."""
        self._look()
        if self._diverged_at is not None:
            raise self._error(f"the loss became non-finite at update {self._diverged_at}")

    def check_weights(self, updates: int) -> None:
        """Checks losses and weights, before these are saved or sent after ``updates``. Raises
        InputError if the network has diverged."""
        self.check()
        if not self.algorithm.is_finite():  # the next loss would show it, but too late
            raise self._error(f"weights became non-finite by update {updates}")

    def was_skipped(self, number: int) -> bool:
        """Returns whether the loss of a recent update was non-finite, as `check` found."""
        return number in self._last_skipped

    def _look(self) -> None:
        # All losses since the last time together, because each look waits for the device.
        seen, self._unseen = self._unseen, []
        losses = torch.stack([result.loss for *_, result in seen]).tolist() if seen else []
        for (number, ids, result), loss in zip(seen, losses, strict=True):
            if math.isfinite(loss):
                continue
            self.skipped += 1
            self._last_skipped.append(number)
            if self.algorithm.is_finite():
                self._quarantine(ids, result.priorities.float().cpu().numpy())
                first = self._last_skipped[0]
                often = len(self._last_skipped) == _MAX_SKIPPED and number - first < _RECENTLY
            else:
                first, often = number, True
            if often and self._diverged_at is None:
                self._diverged_at = first

    def _error(self, how: str) -> InputError:
        return InputError(
            f"{how}: start another run with a smaller --learning.learning-rate, from this one's "
            f"last good network by --initial {self.checkpoint}."
        )

    def _quarantine(self, ids: NDArray[np.int64], priorities: NDArray[np.float32]) -> None:
        """Makes the replay draw the faulty steps no more, all of them if none stands out."""
        faulty = ~np.isfinite(priorities)
        if not faulty.any():
            faulty[:] = True
        self.replay.update_priorities(ids[faulty], np.full(faulty.sum(), np.nan, np.float32))
        self.note(
            f"a minibatch was skipped: its loss is not finite; {faulty.sum()} of its steps are "
            "quarantined, and the replay's log names their actors"
        )
