"""The presets: `paper` against the report's section 4, number by number."""

from dataclasses import replace

import pytest

from common.run.rules import check_config
from common.settings.presets import PRESETS

PAPER = PRESETS["paper"]


@pytest.mark.parametrize("name", list(PRESETS))
def test_a_preset_passes_its_own_check_and_knows_its_name(name: str) -> None:
    config = PRESETS[name]  # type: ignore[index]
    check_config(config)
    assert config.preset == name


def test_paper_plays_as_the_report_did() -> None:
    play = PAPER.play
    assert (play.frame_stack, play.frame_skip, play.random_starts) == (4, 4, 30)
    assert PAPER.env == "ale"
    assert PAPER.game == "pong"


def test_paper_learns_as_the_report_did() -> None:
    learning = PAPER.learning
    assert learning.target == "double"
    assert learning.loss == "mse"
    assert learning.loss_mean_over == "outputs"
    assert learning.optimizer == "rmsprop"
    assert learning.learning_rate == 0.00025
    assert learning.annealing_steps == 0
    assert learning.rmsprop_decay == 0.95
    assert learning.optimizer_epsilon == 0.01
    assert learning.gradient_norm == 0
    assert learning.discount == 0.99
    assert learning.n_step == 1
    assert learning.batch_size == 32
    assert learning.train_period == 4
    assert not learning.scale_pixels
    assert not learning.center_pixels
    # "every 10000 steps, the target network is updated"; here it is counted in updates.
    assert learning.target_update_period * learning.train_period == 10_000


def test_paper_remembers_and_explores_as_the_report_did() -> None:
    assert PAPER.replay.capacity == 1_000_000
    assert PAPER.replay.learning_starts == 50_000
    assert PAPER.replay.sampler == "uniform"
    assert PAPER.samples_per_insert == 8
    assert PAPER.epsilon_at(0) == 1
    assert PAPER.epsilon_at(50_000 + 500_000) == pytest.approx(0.55)
    assert PAPER.epsilon_at(50_000 + 1_000_000) == pytest.approx(0.1)
    assert PAPER.epsilon_at(50_000_000) == pytest.approx(0.1)


def test_paper_is_tested_as_the_report_was() -> None:
    protocol = PAPER.protocol
    assert protocol.epoch_steps == 250_000
    assert protocol.test_steps == 125_000
    assert protocol.test_epsilon == 0.05


def test_the_short_presets_offer_the_games_own_actions() -> None:
    assert PRESETS["robot"].env == "robot"
    assert PRESETS["fast"].env == "ale"
    for name in ("fast", "robot"):
        assert PRESETS[name].play.minimal_actions


@pytest.mark.parametrize(
    ("name", "samples", "steps_of_target", "rate"),
    [("fast", 8, 4_000, 5e-4), ("robot", 4, 2_000, 2.5e-4), ("frugal", 16, 500, 2.5e-4)],
)
def test_the_short_presets_draw_and_copy_by_the_agent_step_and_end_at_one_rate(
    name: str, samples: int, steps_of_target: int, rate: float
) -> None:
    preset = PRESETS[name]  # type: ignore[index]
    learning = preset.learning
    assert preset.samples_per_insert == samples
    assert learning.target_update_period * learning.train_period == steps_of_target
    assert learning.publish_period * learning.train_period == 192
    assert learning.checkpoint_period * learning.train_period == 20_000
    assert learning.learning_rate_at(0) == rate
    end = learning.annealing_steps // learning.train_period + 1
    assert learning.learning_rate_at(end) == pytest.approx(5e-5)


def test_no_network_is_told_of_its_own_body_unless_asked_for() -> None:
    for preset in PRESETS.values():
        assert preset.vector_width == 0
        told = replace(preset, play=replace(preset.play, vector=True))
        assert told.vector_width == {"ale": 128, "robot": 144}[preset.env]
