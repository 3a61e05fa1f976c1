"""Draws minibatches and prepares them ahead of the update, in a thread of its own."""

import queue
import threading
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from learner.algorithm.interface import DeviceBatch, Prepared
from replay.batch import Batch
from replay.interface import Replay

DEPTH = 2
"""Batches ready at once: enough to hide the drawing, few enough to stay fresh."""
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


class Prefetcher:
    """Takes minibatches from ``replay`` as the limiter allows.

    Args:
        prepare: makes them ready to learn from.
        batches: minibatches of the run drawn before, which the limiter must know.
    """

    def __init__(
        self,
        replay: Replay,
        prepare: Callable[[Batch], Prepared],
        batch_size: int,
        batches: int,
    ) -> None:
        self._replay = replay
        self._prepare = prepare
        self._batch_size = batch_size
        self._batches = batches
        self._ready: queue.Queue[Prefetched] = queue.Queue(DEPTH)
        self._closing = threading.Event()
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._draw, name="prefetch", daemon=True)
        self._thread.start()

    def next(self, timeout: float) -> Prefetched | None:
        """The next minibatch, or None if none came in ``timeout`` seconds.

        Raises:
            BaseException: whatever ended the drawing.
        """
        try:
            return self._ready.get(timeout=timeout)
        except queue.Empty:
            if self._failure is not None:
                raise self._failure from None
            return None

    def close(self) -> None:
        self._closing.set()
        self._thread.join()

    def _draw(self) -> None:
        try:
            while not self._closing.is_set():
                batch = self._replay.sample(self._batches * self._batch_size, _WAIT)
                if batch is None:
                    continue
                self._batches += 1
                self._offer(Prefetched(batch.ids, self._prepare(batch)))
        except BaseException as error:
            self._failure = error

    def _offer(self, batch: Prefetched) -> None:
        while not self._closing.is_set():
            try:
                self._ready.put(batch, timeout=_WAIT)
                return
            except queue.Full:
                continue
