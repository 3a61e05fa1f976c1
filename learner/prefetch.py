"""Draws minibatches and prepares them ahead of the update, in a thread of its own."""

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
"""Batches ahead, one of them in the making: enough to hide the drawing, few enough to stay
fresh."""
_WAIT = 0.2


class Prefetched(NamedTuple):
    """A minibatch ready to learn from, and the ids that its new priorities go to."""

    ids: NDArray[np.int64]
    prepared: Prepared


def to_device(batch: Batch, device: torch.device) -> DeviceBatch:
    """Returns the arrays of ``batch`` as tensors; copied without waiting where the device can."""

    def move(array: NDArray[np.generic]) -> Tensor:
        tensor = torch.from_numpy(array if array.flags.writeable else array.copy())
        if device.type == "cuda":
            return tensor.pin_memory().to(device, non_blocking=True)
        return tensor

    batch = batch._replace(a_tm1=batch.a_tm1.astype(np.int64))  # PyTorch's type of an index
    return DeviceBatch(*(move(getattr(batch, name)) for name in DeviceBatch._fields))


@dataclass
class Prefetcher:
    """Takes minibatches from ``replay`` as the limiter allows."""

    replay: Replay
    prepare: Callable[[Batch], Prepared]
    """Makes them ready to learn from."""
    batch_size: int
    batches: int
    """Minibatches of the run drawn before, which the limiter must know."""

    def __post_init__(self) -> None:
        self._closing = threading.Event()
        self._thread = ThreadPoolExecutor(1, "prefetch")
        self._ahead = deque(self._thread.submit(self._draw) for _ in range(DEPTH))

    def next(self, timeout: float) -> Prefetched | None:
        """The next minibatch, or None if none came in ``timeout`` seconds.

        Raises:
            BaseException: whatever ended the drawing.
        """
        wait([self._ahead[0]], timeout)
        if not self._ahead[0].done():
            return None
        self._ahead.append(self._thread.submit(self._draw))
        return self._ahead.popleft().result()

    def close(self) -> None:
        """End the drawing; a second time does nothing."""
        self._closing.set()
        self._thread.shutdown(cancel_futures=True)

    def _draw(self) -> Prefetched | None:
        while not self._closing.is_set():
            batch = self.replay.sample(self.batches * self.batch_size, _WAIT)
            if batch is not None:
                self.batches += 1
                return Prefetched(batch.ids, self.prepare(batch))
        return None
