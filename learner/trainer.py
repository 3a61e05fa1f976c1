"""The update: networks, optimizer, one minibatch at a time."""

import copy
from typing import NamedTuple

import torch
from torch import Tensor

from common.config import LearningConfig
from common.network import QNetwork, as_pixels
from learner.device import Device
from learner.loss import bootstrap_values, td_errors, td_loss
from learner.optimizer import build_optimizer


class DeviceBatch(NamedTuple):
    """A minibatch as tensors on the device; shapes as in `replay.batch.Batch`."""

    s_tm1: Tensor
    a_tm1: Tensor
    r_t: Tensor
    discount_t: Tensor
    s_t: Tensor
    weights: Tensor
    x_tm1: Tensor
    x_t: Tensor


class UpdateResult(NamedTuple):
    """What an update leaves for statistics and priorities; tensors on the device."""

    loss: Tensor
    td_errors: Tensor
    """δ ``[batch]``, before the update."""


class Trainer:
    """Online network, target network and optimizer; knows nothing of time or of others."""

    def __init__(self, network: QNetwork, config: LearningConfig, device: Device) -> None:
        self._config = config
        self._device = device
        self.online = network.to(device.torch)
        self.target = copy.deepcopy(self.online).requires_grad_(False)
        self.optimizer = build_optimizer(self.online.parameters(), config)

    def update(self, batch: DeviceBatch) -> UpdateResult:
        """One gradient step on ``batch``."""
        config = self._config
        with torch.autocast(self._device.torch.type, torch.bfloat16, enabled=self._device.bfloat16):
            with torch.no_grad():
                s_t = as_pixels(batch.s_t)
                q_t_target = self.target(s_t, batch.x_t)
                q_t_online = self.online(s_t, batch.x_t) if config.target == "double" else None
            q_tm1 = self.online(batch.s_tm1, batch.x_tm1)
        errors = td_errors(
            q_tm1,
            batch.a_tm1,
            batch.r_t,
            batch.discount_t,
            bootstrap_values(q_t_target, q_t_online),
        )
        outputs = q_tm1.shape[1] if config.loss_mean_over == "outputs" else 1
        loss = td_loss(errors, batch.weights, config.loss, outputs)
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        if config.gradient_norm:
            torch.nn.utils.clip_grad_norm_(self.online.parameters(), config.gradient_norm)
        self.optimizer.step()
        return UpdateResult(loss.detach(), errors.detach())

    def copy_to_target(self) -> None:
        """Let the target network be the online one."""
        self.target.load_state_dict(self.online.state_dict())

    @torch.no_grad()
    def max_q(self, frames: Tensor, vectors: Tensor) -> Tensor:
        """The online network's highest value of each state, ``float32 [N]``, on the CPU."""
        values = [
            self.online(f.to(self._device.torch), v.to(self._device.torch)).amax(dim=1).cpu()
            for f, v in zip(torch.split(frames, 256), torch.split(vectors, 256), strict=True)
        ]
        return torch.cat(values)
