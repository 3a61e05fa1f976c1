"""The algorithms by the names that ``--learning.algorithm`` takes."""

from collections.abc import Callable

from common.errors import InputError
from common.network import QNetwork
from common.run.config import LearningConfig, RunConfig
from learner.algorithm.double_dqn import double_dqn
from learner.algorithm.interface import Algorithm
from learner.algorithm.qr_dqn import qr_dqn
from learner.device import Device

Factory = Callable[[QNetwork, LearningConfig, Device, int], Algorithm]
"""Builds an algorithm of network, settings, device and seed of its random numbers."""

ALGORITHMS: dict[str, Factory] = {"dqn": double_dqn, "qr_dqn": qr_dqn}
"""Add one by an entry here and, where it needs another network, in `common.network.NETWORKS`."""


def build_algorithm(config: RunConfig, network: QNetwork, device: Device) -> Algorithm:
    """Returns the run's algorithm, which begins with ``network``.

    Raises:
        InputError: the configuration names an unknown algorithm.
    """
    name = config.learning.algorithm
    if name not in ALGORITHMS:
        raise InputError(
            f"learning.algorithm is {name!r}: choose one of {', '.join(sorted(ALGORITHMS))}."
        )
    return ALGORITHMS[name](network, config.learning, device, config.seed)
