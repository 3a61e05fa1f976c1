"""Minibatches drawn ahead: in order, counted for the limiter, and with their failures."""

import threading
from typing import cast

import numpy as np
import pytest
import torch

from learner.algorithm.interface import DeviceBatch, Prepared
from learner.prefetch import DEPTH, Prefetcher, to_device
from replay.batch import Batch
from replay.interface import Replay


def _batch(number: int) -> Batch:
    frames = np.full((2, 4, 84, 84), number, np.uint8)
    return Batch(
        ids=np.array([number, number]),
        s_tm1=frames,
        a_tm1=np.array([1, 2], np.uint8),
        r_t=np.zeros(2, np.float32),
        discount_t=np.ones(2, np.float32),
        s_t=frames,
        weights=np.ones(2, np.float32),
        x_tm1=np.zeros((2, 0), np.float32),
        x_t=np.zeros((2, 0), np.float32),
    )


class Source:
    """Gives numbered batches up to ``last``, then what ``after`` says."""

    def __init__(self, last: int, failure: Exception | None = None) -> None:
        self.drawn: list[int] = []
        self.last = last
        self.failure = failure
        self.asked = threading.Semaphore(0)

    def sample(self, drawn: int, timeout: float) -> Batch | None:
        self.asked.release()
        if len(self.drawn) == self.last:
            if self.failure is not None:
                raise self.failure
            return None
        self.drawn.append(drawn)
        return _batch(len(self.drawn))


def _prepare(batch: Batch, ahead: bool) -> Prepared:
    tensors = to_device(batch, torch.device("cpu"))
    return Prepared(tensors, tensors.s_tm1, tensors.s_t)


def _prefetcher(source: Source, batches: int) -> Prefetcher:
    return Prefetcher(cast(Replay, source), _prepare, 2, batches)


def test_batches_come_in_order_and_the_limiter_hears_of_all_draws() -> None:
    source = Source(last=5)
    prefetcher = _prefetcher(source, batches=10)
    found = [prefetcher.next(60) for _ in range(5)]
    assert [int(batch.ids[0]) for batch in found if batch] == [1, 2, 3, 4, 5]
    assert all(batch and batch.prepared.batch.a_tm1.dtype == torch.int64 for batch in found)
    assert source.drawn == [20, 22, 24, 26, 28]
    assert prefetcher.next(0.01) is None
    prefetcher.close()


def test_it_tells_whether_another_minibatch_waits_already() -> None:
    told: list[bool] = []
    drawn = threading.Semaphore(0)

    def prepare(batch: Batch, ahead: bool) -> Prepared:
        told.append(ahead)
        drawn.release()
        return _prepare(batch, ahead)

    source = Source(last=DEPTH + 1)
    prefetcher = Prefetcher(cast(Replay, source), prepare, 2, batches=10)
    for _ in range(DEPTH):
        assert drawn.acquire(timeout=60)
    assert told == [False, *[True] * (DEPTH - 1)]
    for _ in range(DEPTH + 1):
        prefetcher.next(60)
    prefetcher.close()
    assert len(told) == DEPTH + 1


def test_no_other_minibatch_waits_while_the_learner_takes_each_at_once() -> None:
    drawn, told = threading.Semaphore(0), []

    class Slow(Source):
        def sample(self, drawn_so_far: int, timeout: float) -> Batch | None:
            assert drawn.acquire(timeout=60)
            return super().sample(drawn_so_far, timeout)

    def prepare(batch: Batch, ahead: bool) -> Prepared:
        told.append(ahead)
        return _prepare(batch, ahead)

    prefetcher = Prefetcher(cast(Replay, Slow(last=100)), prepare, 2, batches=7)
    for _ in range(4):
        drawn.release()  # only when the one before was taken
        assert prefetcher.next(60) is not None
    assert told == [False] * 4
    for _ in range(DEPTH):
        drawn.release()
    prefetcher.close()


def test_a_minibatch_comes_to_the_device_whole() -> None:
    scores = np.array([3.5, -1.0], np.float32)
    lucky = np.array([True, False])
    scores.flags.writeable = False  # as in a message
    batch = _batch(7)._replace(drawn={"scores": scores, "lucky": lucky})
    found = to_device(batch, torch.device("cpu"))
    for name in set(found._fields) - {"drawn"}:
        assert (getattr(found, name).numpy() == getattr(batch, name)).all()
    assert {name: values.tolist() for name, values in found.drawn.items()} == {
        "scores": [3.5, -1.0],
        "lucky": [True, False],
    }


def test_a_gpu_copies_from_pinned_memory_without_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    pinned: list[int] = []
    moved: list[tuple[int, str, bool]] = []

    def pin(tensor: torch.Tensor) -> torch.Tensor:
        pinned.append(tensor.data_ptr())
        return tensor

    def move(tensor: torch.Tensor, device: torch.device, *, non_blocking: bool) -> torch.Tensor:
        moved.append((tensor.data_ptr(), device.type, non_blocking))
        return tensor

    monkeypatch.setattr(torch.Tensor, "pin_memory", pin)
    monkeypatch.setattr(torch.Tensor, "to", move)
    drawn = _batch(1)._replace(drawn={"scores": np.ones(2, np.float32)})
    to_device(drawn, torch.device("cuda"))
    assert moved == [(place, "cuda", True) for place in pinned]
    assert len(moved) == len(DeviceBatch._fields)  # `drawn` has one array
    to_device(drawn, torch.device("cpu"))
    assert len(moved) == len(pinned) == len(DeviceBatch._fields)


def test_it_draws_no_further_ahead_than_its_depth() -> None:
    source = Source(last=100)
    prefetcher = _prefetcher(source, batches=0)
    for _ in range(DEPTH):
        assert source.asked.acquire(timeout=60)
    assert not source.asked.acquire(timeout=0.3)
    prefetcher.close()


def test_a_failure_reaches_the_learner() -> None:
    prefetcher = _prefetcher(Source(last=0, failure=RuntimeError("the disk is gone")), batches=0)
    with pytest.raises(RuntimeError, match="the disk is gone"):
        prefetcher.next(60)
    prefetcher.close()
