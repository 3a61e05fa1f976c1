"""The target network: a copy of the online network that stands still between two syncs."""

import copy
import threading
from collections.abc import Callable
from typing import TypeVar

import torch

from common.network import QNetwork
from learner.algorithm.precision import precision_of
from learner.device import Device

T = TypeVar("T")


class TargetNetwork:
    """A frozen copy of ``online``, evaluated in one thread and synced in another."""

    def __init__(self, online: QNetwork, device: Device) -> None:
        self.network = copy.deepcopy(online).requires_grad_(False)
        self.version = 0
        """Number of syncs so far; outputs of an older version are stale."""
        self._precision = precision_of(self.network, device)
        self._lock = threading.Lock()

    def evaluate(self, outputs: Callable[[QNetwork], T]) -> tuple[T, int]:
        """Returns the ``outputs`` of the network, and its version."""
        # Not during a sync, which would mix old weights with new ones.
        with self._lock, torch.no_grad():
            return outputs(self._precision.network), self.version

    def sync(self, online: QNetwork) -> None:
        """Copies the weights of ``online``."""
        with self._lock:
            self.network.load_state_dict(online.state_dict())
            self.version += 1
