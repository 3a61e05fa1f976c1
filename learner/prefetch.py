"""Draws and prepares minibatches ahead of the update, in a thread of its own."""

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from learner.algorithm.interface import DeviceBatch, Prepared
from replay.batch import Batch
from replay.interface import Replay

DEPTH = 3
"""Number of batches ahead, including the one that is being drawn: enough to hide the drawing, few
enough to stay fresh. A `replay.client.RemoteReplay` has asked for `AHEAD` more by then."""
_WAIT = 0.2
"""Maximum number of seconds that the replay waits for enough steps before it answers."""


class Prefetched(NamedTuple):
    """A prepared minibatch, and the ids ``int64 [batch]`` of its steps, which receive the new
    priorities."""

    ids: NDArray[np.int64]
    prepared: Prepared


def to_device(batch: Batch, device: torch.device) -> DeviceBatch:
    """Returns ``batch`` as tensors on ``device``; CUDA copies them without waiting."""

    def move(array: NDArray[np.generic]) -> Tensor:
        tensor = torch.from_numpy(array if array.flags.writeable else array.copy())
        if device.type == "cuda":
            return tensor.pin_memory().to(device, non_blocking=True)
        return tensor

    batch = batch._replace(a_tm1=batch.a_tm1.astype(np.int64))  # PyTorch's index type
    names = (name for name in DeviceBatch._fields if name != "drawn")
    return DeviceBatch(
        **{name: move(getattr(batch, name)) for name in names},
        drawn={name: move(array) for name, array in batch.drawn.items()},
    )


@dataclass
class Prefetcher:
    """Draws minibatches from ``replay`` as fast as the limiter allows."""

    replay: Replay
    prepare: Callable[[Batch, bool], Prepared]
    """Prepares a minibatch for the update, and takes whether others wait for theirs already."""
    batch_size: int
    batches: int
    """Minibatches that the run has drawn so far, which the limiter must know."""

    def __post_init__(self) -> None:
        self._closing = threading.Event()
        self._taken = self.batches
        self._thread = ThreadPoolExecutor(1, "prefetch")
        self._ahead = deque(self._thread.submit(self._draw) for _ in range(DEPTH))

    def next(self, timeout: float) -> Prefetched | None:
        """Returns the next minibatch, or None if none came within ``timeout`` seconds.

        Raises:
            BaseException: the error that ended the drawing.
        """
        wait([self._ahead[0]], timeout)
        if not self._ahead[0].done():
            return None
        self._taken += 1
        self._ahead.append(self._thread.submit(self._draw))
        return self._ahead.popleft().result()

    def close(self) -> None:
        """Ends the drawing; a second call does nothing."""
        self._closing.set()
        self._thread.shutdown(cancel_futures=True)

    def _draw(self) -> Prefetched | None:
        while not self._closing.is_set():
            batch = self.replay.sample(self.batches * self.batch_size, _WAIT)
            if batch is not None:
                ahead = self.batches > self._taken
                self.batches += 1
                return Prefetched(batch.ids, self.prepare(batch, ahead))
        return None
