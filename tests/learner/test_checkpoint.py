"""Checkpoints: whole, atomic, and refused when damaged."""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import pytest
import torch

from common.errors import InputError
from common.network import QNetwork
from common.run.config import LearningConfig
from learner.algorithm.double_dqn import double_dqn
from learner.algorithm.interface import Algorithm
from learner.checkpoint import load_checkpoint, previous_of, save_checkpoint
from learner.device import Device
from tests.learner.small_batches import learn, random_batch

CPU = Device(torch.device("cpu"), bfloat16=False)


def _algorithm(seed: int, optimizer: Literal["adam", "rmsprop"] = "adam") -> Algorithm:
    torch.manual_seed(seed)
    config = replace(LearningConfig(), optimizer=optimizer, learning_rate=1e-3)
    return double_dqn(QNetwork(6), config, CPU)


@pytest.mark.parametrize("optimizer", ["adam", "rmsprop"])
def test_training_goes_on_as_if_it_had_never_stopped(
    tmp_path: Path, optimizer: Literal["adam", "rmsprop"]
) -> None:
    path = tmp_path / "checkpoint.safetensors"
    steady = _algorithm(0, optimizer)
    for seed in range(3):
        learn(steady, random_batch(seed=seed))
    save_checkpoint(path, steady, {"updates": 3, "scores": [1.5, -2.0]})
    resumed = _algorithm(99, optimizer)

    state = load_checkpoint(path, resumed)

    assert state == {"updates": 3, "scores": [1.5, -2.0]}
    for seed in range(3, 6):
        ours, theirs = (
            learn(resumed, random_batch(seed=seed)),
            learn(steady, random_batch(seed=seed)),
        )
        assert torch.equal(ours.loss, theirs.loss)
    ours_at_end, theirs_at_end = resumed.state(), steady.state()
    assert ours_at_end.keys() == theirs_at_end.keys()
    assert {name.split(".")[0] for name in ours_at_end} == {"online", "target", "optimizer"}
    for name, value in ours_at_end.items():
        assert torch.equal(value, theirs_at_end[name]), name


def test_the_one_before_is_kept(tmp_path: Path) -> None:
    path, algorithm = tmp_path / "checkpoint.safetensors", _algorithm(0)
    for updates in (1, 2, 3):
        save_checkpoint(path, algorithm, {"updates": updates})
    assert load_checkpoint(path, algorithm) == {"updates": 3}
    assert load_checkpoint(previous_of(path), algorithm) == {"updates": 2}
    assert {file.name for file in tmp_path.iterdir()} == {path.name, previous_of(path).name}


@pytest.mark.parametrize("spot", [0.001, 0.3, 0.6, 0.99])
def test_a_flipped_bit_is_noticed(tmp_path: Path, spot: float) -> None:
    path, algorithm = tmp_path / "checkpoint.safetensors", _algorithm(0)
    learn(algorithm, random_batch())
    save_checkpoint(path, algorithm, {"updates": 1})
    content = bytearray(path.read_bytes())
    content[int(len(content) * spot)] ^= 0x10
    path.write_bytes(content)
    with pytest.raises(InputError, match="damaged"):
        load_checkpoint(path, _algorithm(1))


def test_a_truncated_file_is_noticed_and_the_way_out_is_named(tmp_path: Path) -> None:
    path, algorithm = tmp_path / "checkpoint.safetensors", _algorithm(0)
    for updates in (1, 2):
        save_checkpoint(path, algorithm, {"updates": updates})
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match=previous_of(path).name):
        load_checkpoint(path, algorithm)


def test_another_networks_checkpoint_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.safetensors"
    save_checkpoint(path, _algorithm(0), {"updates": 1})
    other = double_dqn(QNetwork(18), LearningConfig(), CPU)
    with pytest.raises(InputError, match="damaged"):
        load_checkpoint(path, other)
