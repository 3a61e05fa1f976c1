"""`EarlyChoice`: the online network's choice of next actions, ahead of the update that needs it."""

import threading

import torch
from torch import Tensor

from common.network import QNetwork
from common.settings.config import LearningConfig
from learner.algorithm.interface import Prepared
from learner.algorithm.precision import Precision, precision_of
from learner.device import Device


class EarlyChoice:
    """Computes the online network's values of s_t while another thread computes an update.

    Double DQN lets the online network choose the next action, so a forward pass of an update needs
    the weights that the update before has made. With those of a few updates before, another core
    can do it ahead. The target network, which rates the chosen action, is hundreds of updates old.
    """

    def __init__(self, precision: Precision) -> None:
        self._precision = precision
        self.writing = threading.Lock()
        """The thread of the updates holds it while it changes the network's weights."""

    @classmethod
    def of(cls, online: QNetwork, config: LearningConfig, device: Device) -> "EarlyChoice | None":
        """Returns the choice for ``online``, or None: if it is not asked for; on a GPU, which
        computes one thing after the other; or if ``online`` computes with its own weights, which an
        update changes meanwhile."""
        if not config.early_choice or config.target != "double" or device.torch.type != "cpu":
            return None
        precision = precision_of(online, device)
        return None if precision.network is online else cls(precision)

    @torch.no_grad()
    def values(self, prepared: Prepared) -> Tensor:
        """Returns the network's present values of ``s_t``, ``float32 [batch, actions]``.

        Layers that the native kernel leaves to PyTorch have the network's own weights: if an update
        changes them meanwhile, some are already those of the next one.
        """
        with self.writing:
            self._precision.sync_from_master()
        values: Tensor = self._precision.network(prepared.pixels_t, prepared.batch.x_t)
        return values
