"""Checkpoints: whole, atomic, and refused when damaged."""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import pytest
import torch

from common.errors import InputError
from common.network import QNetwork
from common.run.config import LearningConfig
from learner.algorithm.trainer import Trainer
from learner.checkpoint import load_checkpoint, previous_of, save_checkpoint
from learner.device import Device
from tests.learner.small_batches import random_batch


def _trainer(seed: int, optimizer: Literal["adam", "rmsprop"] = "adam") -> Trainer:
    torch.manual_seed(seed)
    config = replace(LearningConfig(), optimizer=optimizer, learning_rate=1e-3)
    return Trainer(QNetwork(6), config, Device(torch.device("cpu"), bfloat16=False))


@pytest.mark.parametrize("optimizer", ["adam", "rmsprop"])
def test_training_goes_on_as_if_it_had_never_stopped(
    tmp_path: Path, optimizer: Literal["adam", "rmsprop"]
) -> None:
    path = tmp_path / "checkpoint.safetensors"
    steady = _trainer(0, optimizer)
    for seed in range(3):
        steady.update(random_batch(seed=seed))
    save_checkpoint(path, steady, {"updates": 3, "scores": [1.5, -2.0]})
    resumed = _trainer(99, optimizer)

    state = load_checkpoint(path, resumed)

    assert state == {"updates": 3, "scores": [1.5, -2.0]}
    for seed in range(3, 6):
        ours, theirs = (
            resumed.update(random_batch(seed=seed)),
            steady.update(random_batch(seed=seed)),
        )
        assert torch.equal(ours.loss, theirs.loss)
    for one, other in zip(resumed.online.parameters(), steady.online.parameters(), strict=True):
        assert torch.equal(one, other)
    for one, other in zip(resumed.target.parameters(), steady.target.parameters(), strict=True):
        assert torch.equal(one, other)


def test_the_one_before_is_kept(tmp_path: Path) -> None:
    path, trainer = tmp_path / "checkpoint.safetensors", _trainer(0)
    for updates in (1, 2, 3):
        save_checkpoint(path, trainer, {"updates": updates})
    assert load_checkpoint(path, trainer) == {"updates": 3}
    assert load_checkpoint(previous_of(path), trainer) == {"updates": 2}
    assert {file.name for file in tmp_path.iterdir()} == {path.name, previous_of(path).name}


@pytest.mark.parametrize("spot", [0.001, 0.3, 0.6, 0.99])
def test_a_flipped_bit_is_noticed(tmp_path: Path, spot: float) -> None:
    path, trainer = tmp_path / "checkpoint.safetensors", _trainer(0)
    trainer.update(random_batch())
    save_checkpoint(path, trainer, {"updates": 1})
    content = bytearray(path.read_bytes())
    content[int(len(content) * spot)] ^= 0x10
    path.write_bytes(content)
    with pytest.raises(InputError, match="damaged"):
        load_checkpoint(path, _trainer(1))


def test_a_truncated_file_is_noticed_and_the_way_out_is_named(tmp_path: Path) -> None:
    path, trainer = tmp_path / "checkpoint.safetensors", _trainer(0)
    for updates in (1, 2):
        save_checkpoint(path, trainer, {"updates": updates})
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match=previous_of(path).name):
        load_checkpoint(path, trainer)


def test_another_networks_checkpoint_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.safetensors"
    save_checkpoint(path, _trainer(0), {"updates": 1})
    other = Trainer(QNetwork(18), LearningConfig(), Device(torch.device("cpu"), bfloat16=False))
    with pytest.raises(InputError, match="damaged"):
        load_checkpoint(path, other)
