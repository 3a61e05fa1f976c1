"""The interface between learner and algorithm.

An algorithm owns everything that a gradient step changes: its networks, its optimizer, their state.
Training loop, checkpoint and prefetcher know only `Algorithm`.
"""

from collections.abc import Mapping
from typing import NamedTuple, Protocol

from torch import Tensor

from common.network import QNetwork
from common.registry import ALGORITHMS
from common.settings.config import RunConfig
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
    drawn: Mapping[str, Tensor] = {}


class Prepared(NamedTuple):
    """A minibatch with everything that can be computed before its turn."""

    batch: DeviceBatch
    """The minibatch, as drawn or augmented."""
    pixels_tm1: Tensor
    """``batch.s_tm1`` in the network's precision."""
    pixels_t: Tensor
    target_outputs: tuple[Tensor, ...] = ()
    """The outputs of the target network that the loss function needs."""
    target_version: int = -1
    """Version of the target network that computed them."""
    q_t: Tensor | None = None
    """The online network's values of ``s_t``, ``float32 [batch, actions]``, if it is to choose the
    next actions by the weights that it had then, and not by those of the update's turn."""


class Update(NamedTuple):
    """The result of a loss function and of an update, as tensors on the device."""

    loss: Tensor
    """Scalar."""
    priorities: Tensor
    """Priorities of the transitions in prioritised replay, ``float32 [batch]``, not negative. A
    transition that makes the loss non-finite has a non-finite priority."""
    td_errors: Tensor
    """δ, the targets less the values before the update, ``float32 [batch]``."""
    targets: Tensor
    """What those values should have been, ``float32 [batch]``."""
    metrics: Mapping[str, Tensor] = {}
    """The algorithm's own scalars by name, with the same names at every update."""

    def detached(self) -> "Update":
        """Returns the same without gradients, which would keep the whole update in memory."""
        return Update(
            *(self.loss.detach(), self.priorities.detach()),
            *(self.td_errors.detach(), self.targets.detach()),
            {name: value.detach() for name, value in self.metrics.items()},
        )


class Algorithm(Protocol):
    """Learns the run's network from minibatches, one gradient step at a time."""

    @property
    def published(self) -> QNetwork:
        """The network whose weights are published, tested and evaluated."""

    def prepare(self, batch: DeviceBatch, *, ahead: bool = False) -> Prepared:
        """Computes what does not depend on earlier updates, in another thread than `update`.

        Args:
            ahead: whether minibatches wait for their update already, so that there is time to
                compute more.
        """

    def update(self, prepared: Prepared) -> Update:
        """Takes one gradient step, and syncs the target network when it is due.

        A non-finite loss changes no weight; the learner quarantines its steps.
        """

    def is_finite(self) -> bool:
        """Returns whether all weights are finite, those that learn and those that are published."""

    def max_q(self, frames: Tensor, vectors: Tensor) -> Tensor:
        """Returns the highest value of each state, ``float32 [states]``, on the CPU."""

    def state(self) -> dict[str, Tensor]:
        """Returns everything that a checkpoint must hold, by name.

        The names let `common.run.network_file.decode_network_file` find the weights of `published`.
        """

    def load_state(self, state: Mapping[str, Tensor]) -> None:
        """Restores what `state` returned.

        Raises:
            ValueError: it belongs to another network or optimizer.
        """

    def continue_from(self, updates: int) -> None:
        """Continues after the ``updates`` of an earlier process: the learning rate's fall and the
        target network's period go on, and that process's random numbers are not drawn again."""


def build_algorithm(config: RunConfig, network: QNetwork, device: Device) -> Algorithm:
    """Returns the run's algorithm, which starts from ``network``."""
    learning = config.learning
    algorithm: Algorithm = ALGORITHMS.make(
        learning.algorithm, network, learning, device, config.seed
    )
    return algorithm
