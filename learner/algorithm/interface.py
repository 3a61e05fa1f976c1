"""What the learner asks of an algorithm, and what the two hand each other.

An algorithm owns everything that a gradient step changes: its networks, its optimizer, their state.
The training loop, the checkpoint and the prefetcher know it by `Algorithm` alone.
"""

from collections.abc import Mapping
from typing import NamedTuple, Protocol

from torch import Tensor

from common.network import QNetwork
from common.registry import ALGORITHMS
from common.run.config import RunConfig
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
    """A minibatch with everything that can be computed before its turn."""

    batch: DeviceBatch
    """As drawn, or augmented."""
    pixels_tm1: Tensor
    """``batch.s_tm1`` in the network's precision."""
    pixels_t: Tensor
    target_outputs: tuple[Tensor, ...] = ()
    """What the loss function wanted of the target network."""
    target_version: int = -1
    """Which target network that was."""


class Update(NamedTuple):
    """What a loss function returns, and what an update leaves; tensors on the device."""

    loss: Tensor
    """Scalar."""
    priorities: Tensor
    """Priorities of the transitions in prioritised replay, ``float32 [batch]``, not negative; not
    finite where a transition is at fault for a loss that is not."""
    metrics: Mapping[str, Tensor]
    """Scalars by name, the same names at every update; ``td_error_squared`` is the mean δ² of the
    values, before the update."""


class Algorithm(Protocol):
    """Learns the run's network from minibatches, one gradient step at a time."""

    @property
    def published(self) -> QNetwork:
        """The network whose weights are published, tested and evaluated."""

    def prepare(self, batch: DeviceBatch) -> Prepared:
        """Computes what does not depend on the updates before; from one thread, not `update`'s."""

    def update(self, prepared: Prepared) -> Update:
        """Takes one gradient step, and syncs the target network when it is due.

        A loss that is not finite changes no weight; the learner has its steps quarantined.
        """

    def max_q(self, frames: Tensor, vectors: Tensor) -> Tensor:
        """Returns the highest value of each state, ``float32 [states]``, on the CPU."""

    def state(self) -> dict[str, Tensor]:
        """Returns everything that a checkpoint must hold, by names under which
        `common.protocol.weights.load_weights` finds the weights of `published`."""

    def load_state(self, state: Mapping[str, Tensor]) -> None:
        """Takes over what `state` returned.

        Raises:
            ValueError: it is another network's or optimizer's.
        """

    def reseed(self, updates: int) -> None:
        """Continues after ``updates`` that an earlier process made: its target period goes on, and
        its random numbers are not drawn again."""


def build_algorithm(config: RunConfig, network: QNetwork, device: Device) -> Algorithm:
    """Returns the run's algorithm, which begins with ``network``."""
    learning = config.learning
    algorithm: Algorithm = ALGORITHMS.make(
        learning.algorithm, network, learning, device, config.seed
    )
    return algorithm
