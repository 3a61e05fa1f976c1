"""A network of another package: dueling streams (Wang et al. 2016), with quantiles."""

from typing import Any

from torch import Tensor, nn

from common.network import LAYERS, QNetwork
from common.registry import AlgorithmKind
from common.settings.config import LearningConfig


class DuelingNetwork(QNetwork):
    """A value of the state, and an advantage of each action, from one dense layer."""

    def __init__(
        self,
        actions: int,
        frame_stack: int,
        vector_width: int,
        learning: LearningConfig,
        **sizes: Any,
    ) -> None:
        super().__init__(actions, frame_stack, vector_width, learning, **sizes)
        self.value = nn.Linear(LAYERS[learning.network].hidden, sizes["atoms"])

    def outputs(self, hidden: Tensor) -> Tensor:
        advantages = self.actions(hidden).unflatten(1, (self.action_count, -1))
        centred = advantages - advantages.mean(dim=1, keepdim=True)  # equation 9
        outputs: Tensor = (self.value(hidden)[:, None] + centred).flatten(1)
        return outputs


DUELING = AlgorithmKind(
    "dueling",
    "learner.algorithm.qr_dqn:qr_dqn",
    network=DuelingNetwork,
    atoms=lambda learning: learning.quantiles,
    ignores=("loss", "loss_mean_over"),
)
