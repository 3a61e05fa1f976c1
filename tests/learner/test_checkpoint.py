"""Checkpoints: whole, atomic, refused when damaged, and written only where there is room."""

import errno
import os
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save

from common.errors import InputError
from common.network import QNetwork
from common.settings.config import LearningConfig, RunConfig
from learner.algorithm.double_dqn import double_dqn
from learner.algorithm.interface import Algorithm
from learner.checkpoint import Checkpoint, _crc32
from learner.device import Device
from tests.learner.small_batches import learn, random_batch

CPU = Device(torch.device("cpu"), bfloat16=False)


def _algorithm(seed: int, optimizer: Literal["adam", "rmsprop"] = "adam") -> Algorithm:
    torch.manual_seed(seed)
    config = replace(LearningConfig(), optimizer=optimizer, learning_rate=1e-3)
    return double_dqn(QNetwork(6), config, CPU)


def checkpoint_of(folder: Path, algorithm: Algorithm) -> Checkpoint:
    return Checkpoint(
        folder / "checkpoint.safetensors",
        folder / "checkpoint.previous.safetensors",
        *(algorithm, RunConfig()),
    )


def load(checkpoint: Checkpoint) -> dict[str, Any]:
    """What it holds, where nothing needs to be said."""
    said: list[str] = []
    state = checkpoint.load(said.append)
    assert said == []
    return state


@pytest.mark.parametrize("optimizer", ["adam", "rmsprop"])
def test_training_goes_on_as_if_it_had_never_stopped(
    tmp_path: Path, optimizer: Literal["adam", "rmsprop"]
) -> None:
    steady = _algorithm(0, optimizer)
    for seed in range(3):
        learn(steady, random_batch(seed=seed))
    checkpoint_of(tmp_path, steady).save({"updates": 3, "scores": [1.5, -2.0]})
    resumed = _algorithm(99, optimizer)

    state = load(checkpoint_of(tmp_path, resumed))

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
    checkpoint = checkpoint_of(tmp_path, _algorithm(0))
    for updates in (1, 2, 3):
        checkpoint.save({"updates": updates})
    assert load(checkpoint) == {"updates": 3}
    assert {file.name for file in tmp_path.iterdir()} == {
        "checkpoint.safetensors",
        "checkpoint.previous.safetensors",
    }
    checkpoint.previous.replace(checkpoint.path)
    assert load(checkpoint) == {"updates": 2}


@pytest.mark.parametrize("spot", [0.001, 0.3, 0.6, 0.99])
def test_a_flipped_bit_is_noticed(tmp_path: Path, spot: float) -> None:
    algorithm = _algorithm(0)
    learn(algorithm, random_batch())
    checkpoint = checkpoint_of(tmp_path, algorithm)
    checkpoint.save({"updates": 1})
    content = bytearray(checkpoint.path.read_bytes())
    content[int(len(content) * spot)] ^= 0x10
    checkpoint.path.write_bytes(content)
    with pytest.raises(InputError, match="damaged"):
        load(checkpoint_of(tmp_path, _algorithm(1)))


@pytest.mark.parametrize(
    ("part", "changed"),
    [(b"1234", b"1235"), (b'"target.', b'"targev.')],
    ids=["counters", "a tensor's name"],
)
def test_what_changed_on_the_disk_is_noticed(part: bytes, changed: bytes, tmp_path: Path) -> None:
    """It is damage, and not another network's checkpoint."""
    checkpoint = checkpoint_of(tmp_path, _algorithm(0))
    checkpoint.save({"updates": 1_234})
    checkpoint.path.write_bytes(checkpoint.path.read_bytes().replace(part, changed))
    with pytest.raises(InputError, match="checksum does not match"):
        load(checkpoint)


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


def _into_a_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)  # who opens one waits for a writer for ever


def _counters(path: Path, text: str) -> None:
    """Gives the file other counters, and the right checksum."""
    with safe_open(path, "pt") as file:
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    path.write_bytes(save(tensors, {"state": text, "checksum": str(_crc32(tensors, text))}))


def _no_table(path: Path) -> None:
    _counters(path, '["updates"]')


def _without_end(path: Path) -> None:
    _counters(path, "[" * 100_000)  # deeper than Python's parser goes


@pytest.mark.parametrize("spoil", [_cut, Path.unlink, _into_a_pipe, _no_table, _without_end])
def test_the_one_before_takes_the_place_of_one_that_is_damaged_or_missing(
    tmp_path: Path, spoil: Callable[[Path], None]
) -> None:
    checkpoint = checkpoint_of(tmp_path, _algorithm(0))
    for updates in (1, 2):
        checkpoint.save({"updates": updates})
    spoil(checkpoint.path)
    said: list[str] = []
    assert checkpoint_of(tmp_path, _algorithm(1)).load(said.append) == {"updates": 1}
    assert re.match(
        f"WARNING: the checkpoint {checkpoint.path} is damaged or missing .*: the run goes on "
        r"from checkpoint\.previous\.safetensors, the one before\.$",
        said[0],
    )
    assert checkpoint.damaged.exists() == (spoil is not Path.unlink)
    checkpoint.save({"updates": 3})  # and keeps the whole one, not the damaged one
    checkpoint.path.unlink()
    assert checkpoint.load(said.append) == {"updates": 1}
    checkpoint.path.unlink()
    with pytest.raises(InputError, match=r"and so is .*, the one before: put one back"):
        checkpoint.load(said.append)


def test_a_checkpoint_that_cannot_be_written_leaves_both_as_they_were(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checkpoint = checkpoint_of(tmp_path, _algorithm(0))
    for updates in (1, 2):
        checkpoint.save({"updates": updates})

    def fails(file: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("common.atomic_file.os.fsync", fails)
        with pytest.raises(OSError, match="No space"):
            checkpoint.save({"updates": 3})
    assert load(checkpoint) == {"updates": 2}
    assert checkpoint.path.stat().st_ino != checkpoint.previous.stat().st_ino
    assert {file.name for file in tmp_path.iterdir()} == {
        "checkpoint.safetensors",
        "checkpoint.previous.safetensors",
    }


def test_another_networks_checkpoint_is_refused(tmp_path: Path) -> None:
    checkpoint_of(tmp_path, _algorithm(0)).save({"updates": 1})
    other = double_dqn(QNetwork(18), LearningConfig(), CPU)
    with pytest.raises(InputError, match="belongs to another network or optimizer"):
        load(checkpoint_of(tmp_path, other))


@pytest.mark.parametrize("error", [IndexError, KeyError, ValueError, RuntimeError])
def test_whatever_an_algorithm_makes_of_other_tensors_is_told_in_a_sentence(
    tmp_path: Path, error: type[Exception]
) -> None:
    """PyTorch raises RuntimeError; who looks a tensor up that is missing, a LookupError."""

    def load_state(tensors: Any) -> None:
        raise error("weight")

    algorithm: Any = SimpleNamespace(state=dict, load_state=load_state)
    checkpoint_of(tmp_path, algorithm).save({"updates": 1})
    with pytest.raises(InputError, match=r"another network or optimizer \('?weight'?\): give"):
        load(checkpoint_of(tmp_path, algorithm))


def test_a_checkpoint_from_before_it_told_its_settings_is_read(tmp_path: Path) -> None:
    checkpoint = checkpoint_of(tmp_path, _algorithm(0))
    checkpoint.save({"updates": 1})
    with safe_open(checkpoint.path, "pt") as file:
        metadata = file.metadata()
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    del metadata["config"], metadata["checksum"]
    metadata["crc32"] = str(_crc32(tensors))
    checkpoint.path.write_bytes(save(tensors, metadata))
    assert load(checkpoint) == {"updates": 1}


@pytest.fixture
def checkpoint(tmp_path: Path) -> Checkpoint:
    """One of a MiB; two more must fit."""
    path = tmp_path / "checkpoint.safetensors"
    path.write_bytes(bytes(2**20))
    return checkpoint_of(tmp_path, SimpleNamespace())


def test_there_must_be_room_for_two_more(
    checkpoint: Checkpoint, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = {checkpoint.path.parent: SimpleNamespace(free=2 * 2**20, total=2**30)}
    monkeypatch.setattr(shutil, "disk_usage", disk.get)
    checkpoint.check_room()
    disk[checkpoint.path.parent].free -= 1
    with pytest.raises(OSError, match=r"No space left on device; it needs 2 MiB: '.+'") as refused:
        checkpoint.check_room()
    assert refused.value.errno == errno.ENOSPC
    assert refused.value.filename == str(checkpoint.path.parent)
    checkpoint.path.write_bytes(bytes(2**20 + 1))
    with pytest.raises(OSError, match="it needs 3 MiB"):  # 2 would be two bytes too few
        checkpoint.check_room()


def test_a_file_system_without_a_limit_has_room(
    checkpoint: Checkpoint, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=0, total=0))
    checkpoint.check_room()


def test_a_checkpoint_that_somebody_removed_needs_no_room_to_be_written_again(
    checkpoint: Checkpoint,
) -> None:
    checkpoint.path.unlink()
    checkpoint.check_room()


def test_a_disk_that_is_read_only_has_no_room(
    checkpoint: Checkpoint, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "statvfs", lambda path: SimpleNamespace(f_flag=os.ST_RDONLY))
    with pytest.raises(OSError, match="Read-only") as refused:
        checkpoint.check_room()
    assert refused.value.errno == errno.EROFS


def test_what_the_system_refuses_is_no_damage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checkpoint = checkpoint_of(tmp_path, _algorithm(0))
    for updates in (1, 2):
        checkpoint.save({"updates": updates})

    def refuse(*_: Any) -> None:
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    with monkeypatch.context() as patched:
        patched.setattr("learner.checkpoint.safe_open", refuse)
        with pytest.raises(OSError, match="Too many open files"):
            checkpoint.load(print)
    assert checkpoint.load(print) == {"updates": 2}
