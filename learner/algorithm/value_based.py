"""The gradient step that all value-based algorithms share; they differ in the loss function.

Half of an update does not depend on the previous update: turning frames into pixels, and the target
network's outputs. `ValueBased.prepare` does that half, on another core if there is one, while
`ValueBased.update` still works on the previous minibatch. If there is time, it also lets the online
network choose the next actions (`EarlyChoice`).
"""

from collections.abc import Mapping
from contextlib import nullcontext
from typing import Protocol

import torch
from torch import Tensor

from common.network import QNetwork
from common.protocol.weights import are_finite
from common.settings.config import LearningConfig
from learner.algorithm.augmentation import RandomShift
from learner.algorithm.cuda_graph import RecordedStep, Step
from learner.algorithm.early_choice import EarlyChoice
from learner.algorithm.ema import EmaNetwork
from learner.algorithm.interface import DeviceBatch, Prepared, Update
from learner.algorithm.optimizers import BoundedOptimizer
from learner.algorithm.precision import precision_of
from learner.algorithm.target_network import TargetNetwork
from learner.device import Device


class Loss(Protocol):
    """The loss that an algorithm minimises, the only part that differs between algorithms."""

    def target_outputs(self, target: QNetwork, prepared: Prepared) -> tuple[Tensor, ...]:
        """Returns the target network's outputs that `__call__` needs; called ahead of it."""

    def __call__(self, online: QNetwork, prepared: Prepared) -> Update:
        """Returns the loss, with its gradient, priorities and metrics of a minibatch."""


class ValueBased:
    """An `Algorithm` that minimises ``loss`` by gradient steps against a target network.

    Augmentation, precision, target network and optimizer are separate parts.
    """

    def __init__(
        self, network: QNetwork, loss: Loss, config: LearningConfig, device: Device, seed: int = 0
    ) -> None:
        """Builds the parts; ``seed`` is that of the augmentation."""
        self.online = network.to(device.torch)
        self._loss = loss
        self._device = device.torch
        self._augmentation = RandomShift(config.random_shift, seed)
        # Copies before `precision_of`: a later copy would copy its hook, and sync the original.
        self._target = TargetNetwork(self.online, device)
        self._published = EmaNetwork(self.online, config.weights_average)
        self._precision = precision_of(self.online, device)
        self._early_choice = EarlyChoice.of(self.online, config, device)
        self._writing = self._early_choice.writing if self._early_choice else nullcontext()
        self._optimizer = BoundedOptimizer(self.online.parameters(), config, device.native)
        self._graphs = device.graphs
        self._step = self._new_step()
        self._target_update_period = config.target_update_period
        self._updates = 0
        self._networks = {"online": self.online, "target": self._target.network}
        """Networks by the prefix of their weights in a checkpoint."""
        if self.published is not self.online:
            self._networks["average"] = self.published

    @property
    def published(self) -> QNetwork:
        return self._published.network

    def prepare(self, batch: DeviceBatch, *, ahead: bool = False) -> Prepared:
        batch = self._augmentation(batch)
        pixels_tm1 = self._precision.as_pixels(batch.s_tm1)
        pixels_t = self._precision.as_pixels(batch.s_t)
        prepared = self._with_target(Prepared(batch, pixels_tm1, pixels_t))
        if ahead and self._early_choice is not None:
            prepared = prepared._replace(q_t=self._early_choice.values(prepared))
        return prepared

    def _with_target(self, prepared: Prepared) -> Prepared:
        """Returns ``prepared`` with the present target network's outputs."""
        outputs, version = self._target.evaluate(
            lambda target: self._loss.target_outputs(target, prepared)
        )
        return prepared._replace(target_outputs=outputs, target_version=version)

    def update(self, prepared: Prepared) -> Update:
        if prepared.target_version != self._target.version:
            prepared = self._with_target(prepared)
        self._optimizer.set_rate(self._updates)
        result = self._step(prepared)
        self._updates += 1
        self._published.take(self._updates)
        if self._updates % self._target_update_period == 0:
            self._target.sync(self.online)
        return result

    def _new_step(self) -> Step:
        return RecordedStep(self._gradient_step) if self._graphs else self._gradient_step

    def _gradient_step(self, prepared: Prepared) -> Update:
        """Does the part of an update that depends only on tensors, so that it can be recorded."""
        result = self._loss(self._precision.network, prepared)
        self._precision.backward(result.loss)
        with self._writing:
            self._optimizer.step(result.loss.detach())
        self._precision.sync_from_master()
        return result.detached()

    @torch.no_grad()
    def is_finite(self) -> bool:
        networks = {self.online, self.published}  # a mean takes in the other's weights later
        return are_finite([weight for each in networks for weight in each.parameters()])

    @torch.no_grad()
    def max_q(self, frames: Tensor, vectors: Tensor) -> Tensor:
        values = [
            self.published(f.to(self._device), v.to(self._device)).amax(dim=1).cpu()
            for f, v in zip(torch.split(frames, 256), torch.split(vectors, 256), strict=True)
        ]
        return torch.cat(values)

    def state(self) -> dict[str, Tensor]:
        """Returns the state, see `Algorithm.state`: ``online.*``, ``target.*``,
        ``optimizer.INDEX.SLOT``, and ``average.*`` if averaged weights are published."""
        weights = {
            f"{prefix}.{name}": value
            for prefix, network in self._networks.items()
            for name, value in network.state_dict().items()
        }
        return weights | self._optimizer.state()

    def load_state(self, state: Mapping[str, Tensor]) -> None:
        # Optimizer slots are not compared: a new optimizer has none before its first step.
        if any(not name.startswith("optimizer.") for name in state.keys() ^ self.state().keys()):
            raise ValueError("it holds other tensors")
        for prefix, network in self._networks.items():
            weights = {name: state[f"{prefix}.{name}"] for name in network.state_dict()}
            try:
                network.load_state_dict(weights)
            except RuntimeError as error:
                raise ValueError(str(error)) from None
        self._optimizer.load_state(state)
        self._step = self._new_step()  # an old recording would use the optimizer's old tensors

    def continue_from(self, updates: int) -> None:
        self._updates = updates
        self._augmentation.reseed(updates)
