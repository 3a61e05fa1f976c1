"""An algorithm of another package: learns what the random policy's return would be."""

from dataclasses import dataclass

from torch import Tensor

from common.checked import Fraction
from common.network import QNetwork
from common.registry import AlgorithmKind
from common.settings.config import LearningConfig
from common.settings.own_settings import own_settings
from learner.algorithm.interface import Prepared, Update
from learner.algorithm.value_based import ValueBased
from learner.device import Device


@dataclass(frozen=True)
class Settings:
    greed: Fraction = 0.0
    """Share of the best action's value in a state's value."""


class RandomPolicyLoss:
    """Expected SARSA of the policy that takes each action alike, or the best with more greed."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings

    def target_outputs(self, target: QNetwork, prepared: Prepared) -> tuple[Tensor]:
        q_t, greed = target(prepared.pixels_t, prepared.batch.x_t), self.settings.greed
        return ((1 - greed) * q_t.mean(dim=1) + greed * q_t.amax(dim=1),)

    def __call__(self, online: QNetwork, prepared: Prepared) -> Update:
        batch, (v_t,) = prepared.batch, prepared.target_outputs
        q_tm1 = online(prepared.pixels_tm1, batch.x_tm1)
        taken = q_tm1.gather(1, batch.a_tm1[:, None]).squeeze(1)
        targets = batch.r_t + batch.discount_t * v_t
        errors = targets - taken
        return Update(errors.square().mean(), errors.abs(), errors, targets)


def random_policy(
    network: QNetwork, config: LearningConfig, device: Device, seed: int
) -> ValueBased:
    settings = own_settings(Settings, config.algorithm_settings)
    return ValueBased(network, RandomPolicyLoss(settings), config, device, seed)


RANDOM_POLICY = AlgorithmKind("random_policy", random_policy, settings=Settings)
