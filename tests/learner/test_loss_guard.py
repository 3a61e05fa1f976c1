"""When a network has diverged, and when only minibatches are at fault."""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from common.errors import InputError
from learner.algorithm.interface import Update
from learner.loss_guard import LossGuard


def guard() -> LossGuard:
    """A guard of a network whose weights stay finite."""
    algorithm: Any = SimpleNamespace(is_finite=lambda: True)
    replay: Any = SimpleNamespace(update_priorities=lambda ids, priorities: None)
    return LossGuard(algorithm, replay, Path("FILE"), note=lambda text: None)


def add(losses: LossGuard, number: int, loss: float = math.nan) -> None:
    priorities = torch.tensor([1.0, loss])
    update = Update(torch.tensor(loss), priorities, td_errors=priorities, targets=priorities)
    losses.add(number, np.arange(2), update)


@pytest.mark.parametrize(("last", "diverged"), [(199, True), (200, False)])
def test_ten_of_the_hundred_latest_losses_are_the_networks_fault(last: int, diverged: bool) -> None:
    losses = guard()
    for number in (*range(100, 109), last):
        add(losses, number)
    add(losses, last + 1, 0.5)
    if diverged:
        with pytest.raises(InputError, match=r"became non-finite at update 100: .* FILE\.$"):
            losses.check()
    else:
        losses.check()
    assert losses.skipped == 10
    assert losses.was_skipped(last)
    assert not losses.was_skipped(last + 1)


def test_weights_are_not_kept_before_the_latest_losses_were_looked_at() -> None:
    losses = guard()
    for number in range(1, 11):
        add(losses, number)
    with pytest.raises(InputError, match="the loss became non-finite at update 1: "):
        losses.check_weights(10)
    with pytest.raises(InputError, match="the loss became non-finite at update 1: "):
        losses.check()  # it stays diverged
