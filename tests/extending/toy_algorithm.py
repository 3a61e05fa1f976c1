"""An algorithm from outside: learns what the random policy's return would be, then the learner.

python toy_algorithm.py LEARNER'S FLAGS --learning.algorithm random_policy
"""

from torch import Tensor

from common.errors import exit_on_input_error
from common.network import QNetwork
from common.run.config import LearningConfig
from learner.__main__ import main
from learner.algorithm.interface import Prepared, Update
from learner.algorithm.registry import ALGORITHMS
from learner.algorithm.value_based import ValueBased
from learner.device import Device


class RandomPolicyLoss:
    """Expected SARSA of the policy that takes each action alike."""

    def target_outputs(self, target: QNetwork, prepared: Prepared) -> tuple[Tensor]:
        return (target(prepared.pixels_t, prepared.batch.x_t).mean(dim=1),)

    def __call__(self, online: QNetwork, prepared: Prepared) -> Update:
        batch, (v_t,) = prepared.batch, prepared.target_outputs
        q_tm1 = online(prepared.pixels_tm1, batch.x_tm1)
        taken = q_tm1.gather(1, batch.a_tm1[:, None]).squeeze(1)
        squares = (batch.r_t + batch.discount_t * v_t - taken).square()
        done = squares.detach()
        return Update(squares.mean(), done.sqrt(), {"td_error_squared": done.mean()})


def random_policy(
    network: QNetwork, config: LearningConfig, device: Device, seed: int
) -> ValueBased[QNetwork]:
    return ValueBased(network, RandomPolicyLoss(), config, device, seed)


ALGORITHMS["random_policy"] = random_policy

if __name__ == "__main__":
    exit_on_input_error(main)
