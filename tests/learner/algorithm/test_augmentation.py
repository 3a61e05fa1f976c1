"""Random shift, against NumPy's padding and plain slicing."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from common.network import build_network
from common.settings.config import LearningConfig
from common.settings.presets import PRESETS
from learner.algorithm.augmentation import RandomShift
from learner.algorithm.interface import build_algorithm
from learner.device import Device
from tests.learner.small_batches import random_batch


def test_each_state_is_a_window_of_its_padded_self_and_all_windows_come() -> None:
    most, seen = 2, set()
    shift = RandomShift(most, seed=1)
    generator = torch.Generator().manual_seed(0)
    for _ in range(40):
        frames = torch.randint(256, (5, 3, 7, 6), dtype=torch.uint8, generator=generator)
        shifted = shift.shift(frames).numpy()
        assert shifted.shape == (5, 3, 7, 6)
        beyond = ((0, 0), (0, 0), (most, most), (most, most))
        padded = np.pad(frames.numpy(), beyond, mode="edge")
        for state in range(5):
            windows = {
                (y, x): padded[state, :, y : y + 7, x : x + 6]
                for y in range(2 * most + 1)
                for x in range(2 * most + 1)
            }
            found = [at for at, window in windows.items() if np.array_equal(window, shifted[state])]
            assert len(found) == 1
            seen.add(found[0])
    assert len(seen) == 25  # 200 draws miss one of 25 with probability 0.007; the seed is fixed


def test_a_run_that_goes_on_draws_other_shifts_than_at_its_start() -> None:
    frames = torch.randint(256, (32, 1, 84, 84), dtype=torch.uint8)

    def shifted(updates: int, seed: int = 1) -> torch.Tensor:
        shift = RandomShift(4, seed)
        shift.reseed(updates)
        return shift.shift(frames)

    assert torch.equal(shifted(0), RandomShift(4, seed=1).shift(frames))
    assert torch.equal(shifted(500), shifted(500))
    assert not torch.equal(shifted(0), shifted(500))
    assert not torch.equal(shifted(500), shifted(500, seed=2))


def test_no_shift_is_none() -> None:
    batch = random_batch()
    assert RandomShift(0, seed=1)(batch) is batch


def test_the_two_states_of_a_transition_move_apart_and_nothing_else_changes() -> None:
    batch = random_batch(size=16)
    batch = batch._replace(s_t=batch.s_tm1)
    shifted = RandomShift(4, seed=1)(batch)
    same = [torch.equal(*both) for both in zip(shifted.s_tm1, shifted.s_t, strict=True)]
    assert sum(same) <= 3  # one of 81 by chance
    assert not torch.equal(shifted.s_tm1, batch.s_tm1)
    assert not torch.equal(shifted.s_t, batch.s_t)
    assert shifted._replace(s_tm1=batch.s_tm1, s_t=batch.s_t) == batch


@pytest.mark.parametrize("name", ["dqn", "qr_dqn"])
def test_an_algorithm_learns_from_shifted_states_by_the_runs_seed(name: str) -> None:
    learning = LearningConfig(algorithm=name, random_shift=4)
    config, batch = replace(PRESETS["fast"], seed=5, learning=learning), random_batch()
    network = build_network(config, 6)
    algorithm = build_algorithm(config, network, Device(torch.device("cpu"), bfloat16=False))
    for updates in (0, 500):
        algorithm.continue_from(updates)
        shift = RandomShift(4, seed=5)
        shift.reseed(updates)
        prepared, expected = algorithm.prepare(batch), shift(batch)
        assert torch.equal(prepared.batch.s_tm1, expected.s_tm1)
        assert torch.equal(prepared.pixels_tm1, network.as_pixels(expected.s_tm1))
        assert torch.equal(prepared.pixels_t, network.as_pixels(expected.s_t))
