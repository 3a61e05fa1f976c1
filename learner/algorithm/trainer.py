"""The update: networks, optimizer, one minibatch at a time.

Half of what an update needs does not depend on the update before it: the frames as pixels, and
the target network's values of them. `Trainer.prepare` does that half, on another core if there is
one, while `Trainer.learn` is still at the minibatch before.
"""

import copy
import threading
from typing import NamedTuple

import torch
from torch import Tensor

from common.network import QNetwork, as_pixels
from common.run.config import LearningConfig
from learner.algorithm.augmentation import RandomShift
from learner.algorithm.loss import bootstrap_values, td_errors, td_loss
from learner.algorithm.optimizers import build_optimizer, clip_gradients
from learner.algorithm.precision import HalfPrecision
from learner.device import Device


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


class Prepared(NamedTuple):
    """A minibatch with all that can be known before its turn has come."""

    batch: DeviceBatch
    pixels_tm1: Tensor
    """``batch.s_tm1`` in the network's precision."""
    pixels_t: Tensor
    q_t_target: Tensor
    """The target network's values of ``s_t``, ``float32 [batch, actions]``."""
    target_age: int
    """Which target network that was."""


class UpdateResult(NamedTuple):
    """What an update leaves for statistics and priorities; tensors on the device."""

    loss: Tensor
    td_errors: Tensor
    """δ ``[batch]``, before the update."""


class Trainer:
    """Online network, target network and optimizer; knows nothing of time or of others."""

    def __init__(
        self, network: QNetwork, config: LearningConfig, device: Device, seed: int = 0
    ) -> None:
        """``seed`` is of the random shifts."""
        self._config = config
        self._shift = RandomShift(config.random_shift, seed) if config.random_shift else None
        self._device = device
        self.online = network.to(device.torch)
        self.target = copy.deepcopy(self.online).requires_grad_(False)
        self.optimizer = build_optimizer(self.online.parameters(), config)
        self._half_online = HalfPrecision(self.online) if device.bfloat16 else None
        self._half_target = HalfPrecision(self.target) if device.bfloat16 else None
        self._target_age = 0
        self._target_lock = threading.Lock()

    def prepare(self, batch: DeviceBatch) -> Prepared:
        """What can be computed before the turn of ``batch``; from one thread."""
        if self._shift is not None:
            batch = batch._replace(s_tm1=self._shift(batch.s_tm1), s_t=self._shift(batch.s_t))
        return self._evaluate(batch)

    def _evaluate(self, batch: DeviceBatch) -> Prepared:
        dtype = torch.bfloat16 if self._device.bfloat16 else torch.float32
        target = self.target if self._half_target is None else self._half_target.network
        pixels_t = as_pixels(batch.s_t, dtype)
        # Not while the target network is being copied: it would be neither the old nor the new.
        with self._target_lock, torch.no_grad():
            q_t_target, age = target(pixels_t, batch.x_t), self._target_age
        return Prepared(batch, as_pixels(batch.s_tm1, dtype), pixels_t, q_t_target, age)

    def update(self, batch: DeviceBatch) -> UpdateResult:
        """One gradient step on ``batch``, from nothing."""
        return self.learn(self.prepare(batch))

    def learn(self, prepared: Prepared) -> UpdateResult:
        """One gradient step on a minibatch."""
        if prepared.target_age != self._target_age:
            prepared = self._evaluate(prepared.batch)
        batch, config, half = prepared.batch, self._config, self._half_online
        online = self.online if half is None else half.network
        with torch.no_grad():
            double = config.target == "double"
            q_t_online = online(prepared.pixels_t, batch.x_t) if double else None
        q_tm1 = online(prepared.pixels_tm1, batch.x_tm1)
        errors = td_errors(
            q_tm1,
            batch.a_tm1,
            batch.r_t,
            batch.discount_t,
            bootstrap_values(prepared.q_t_target, q_t_online),
        )
        outputs = q_tm1.shape[1] if config.loss_mean_over == "outputs" else 1
        loss = td_loss(errors, batch.weights, config.loss, outputs)
        if half is None:
            self.optimizer.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        if half is not None:
            half.hand_back_gradients()
        if config.gradient_norm:
            clip_gradients(self.online.parameters(), config.gradient_norm)
        self.optimizer.step()
        if half is not None:
            half.follow()
        return UpdateResult(loss.detach(), errors.detach())

    def copy_to_target(self) -> None:
        """Let the target network be the online one."""
        with self._target_lock:
            self.target.load_state_dict(self.online.state_dict())
            self._target_age += 1

    def go_on(self, updates: int) -> None:
        """After so many updates in other processes, do not draw the first ones' shifts again."""
        if self._shift is not None:
            self._shift.go_on(updates)

    @torch.no_grad()
    def max_q(self, frames: Tensor, vectors: Tensor) -> Tensor:
        """The online network's highest value of each state, ``float32 [N]``, on the CPU."""
        values = [
            self.online(f.to(self._device.torch), v.to(self._device.torch)).amax(dim=1).cpu()
            for f, v in zip(torch.split(frames, 256), torch.split(vectors, 256), strict=True)
        ]
        return torch.cat(values)
