"""Another figure: its line in the table, and the line that computes it."""

import csv
from dataclasses import replace
from pathlib import Path

from common.metrics import METRICS, Metric, declare
from common.network import QNetwork
from common.registry import ALGORITHMS, ENVIRONMENTS, AlgorithmKind
from common.settings.config import LearningConfig
from learner.algorithm.double_dqn import DoubleDqnLoss
from learner.algorithm.interface import Prepared, Update
from learner.algorithm.value_based import ValueBased
from learner.device import Device
from tests.extending.test_environment import CONFIG, LAMPS
from tests.extending.whole_run import RUN, added, learned

SPREAD = Metric(
    "learning/action_spread",
    "none",
    ".3",
    "Difference between the best and the worst action's value, mean over the minibatch",
    gate="action_spread",
    summary="action_spread",
)


class SpreadLoss(DoubleDqnLoss):
    """Double DQN that tells how far apart the actions' values are."""

    def __call__(self, online: QNetwork, prepared: Prepared) -> Update:
        update = super().__call__(online, prepared)
        values = online(prepared.pixels_tm1, prepared.batch.x_tm1).detach()
        spread = (values.amax(dim=1) - values.amin(dim=1)).mean()
        return update._replace(metrics={**update.metrics, "action_spread": spread})


def spread_dqn(network: QNetwork, config: LearningConfig, device: Device, seed: int) -> ValueBased:
    return ValueBased(network, SpreadLoss(config), config, device, seed)


def test_a_figure_from_outside_is_in_a_runs_files(tmp_path: Path) -> None:
    declare(SPREAD)
    entry = AlgorithmKind("spread_dqn", spread_dqn)
    config = replace(CONFIG, learning=replace(CONFIG.learning, algorithm="spread_dqn"))
    try:
        with added(ENVIRONMENTS, LAMPS), added(ALGORITHMS, entry):
            summary, _ = learned(config, tmp_path, steps=240)
    finally:
        del METRICS[SPREAD.key]

    assert summary["action_spread"] > 0
    with (tmp_path / RUN / "gates.csv").open() as file:
        assert "action_spread" in next(csv.reader(file))
