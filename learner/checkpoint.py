"""The learner's whole state in one safetensors file: networks, optimizer, and its counters as JSON.

There is no random state to keep: minibatches are drawn by a generator that the replay seeds anew at
each start, random shifts by one that is seeded with the updates so far, and the networks have no
noise of their own.
"""

import json
import os
import zlib
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from common.errors import InputError
from common.run.folder import write_atomically
from learner.algorithm.trainer import Trainer


def previous_of(path: Path) -> Path:
    """Where the checkpoint before the one at ``path`` is kept."""
    return path.with_name(f"{path.stem}.previous{path.suffix}")


def save_checkpoint(path: Path, trainer: Trainer, state: dict[str, Any]) -> None:
    """Write everything to ``path``, atomically; what was there becomes the previous one.

    Args:
        state: counters of the run, of JSON's types.
    """
    tensors = _tensors(trainer)
    metadata = {"state": json.dumps(state), "crc32": str(_crc32(tensors))}
    content = save(tensors, metadata)
    if path.exists():
        # A link first, so that there is a checkpoint at `path` at every moment.
        kept = path.with_name(path.name + ".kept")
        kept.unlink(missing_ok=True)
        os.link(path, kept)
        kept.replace(previous_of(path))
    write_atomically(path, content)


def load_checkpoint(path: Path, trainer: Trainer) -> dict[str, Any]:
    """Put the state at ``path`` into ``trainer`` and return the counters.

    Raises:
        InputError: the file is damaged, or of another network or optimizer.
    """
    try:
        with safe_open(path, "pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        if metadata["crc32"] != str(_crc32(tensors)):
            raise ValueError("its checksum does not fit")
        state: dict[str, Any] = json.loads(metadata["state"])
        expected = _tensors(trainer)
        if tensors.keys() != expected.keys() and not _only_lacks_optimizer(expected, tensors):
            raise ValueError("it holds other tensors")
        _restore(trainer, tensors)
    except (SafetensorError, OSError, KeyError, ValueError, RuntimeError) as error:
        advice = "start the run anew under another name"
        if previous_of(path).exists():
            advice = f"copy {previous_of(path).name} over it to go on from the one before"
        raise InputError(f"the checkpoint {path} is damaged ({error}): {advice}.") from None
    return state


def _only_lacks_optimizer(expected: dict[str, Tensor], found: dict[str, Tensor]) -> bool:
    """An optimizer has no state before its first step, but a checkpoint after it does."""
    missing = found.keys() ^ expected.keys()
    return all(name.startswith("optimizer.") for name in missing)


def _tensors(trainer: Trainer) -> dict[str, Tensor]:
    tensors: dict[str, Tensor] = {}
    for prefix, network in (("online", trainer.online), ("target", trainer.target)):
        for name, value in network.state_dict().items():
            tensors[f"{prefix}.{name}"] = value
    for index, slots in trainer.optimizer.state_dict()["state"].items():
        for name, value in slots.items():
            tensors[f"optimizer.{index}.{name}"] = torch.as_tensor(value)
    return {name: value.detach().cpu().contiguous() for name, value in tensors.items()}


def _restore(trainer: Trainer, tensors: dict[str, Tensor]) -> None:
    for prefix, network in (("online", trainer.online), ("target", trainer.target)):
        network.load_state_dict(
            {
                name.removeprefix(f"{prefix}."): value
                for name, value in tensors.items()
                if name.startswith(f"{prefix}.")
            }
        )
    slots: dict[int, dict[str, Tensor]] = {}
    parameters = list(trainer.online.parameters())
    for key, value in tensors.items():
        if key.startswith("optimizer."):
            _, index, name = key.split(".")
            like = parameters[int(index)]
            if value.shape == like.shape:
                # In the parameter's own memory layout, or the fused kernel would be slow.
                value = torch.empty_like(like).copy_(value).detach()
            slots.setdefault(int(index), {})[name] = value
    groups = trainer.optimizer.state_dict()["param_groups"]
    trainer.optimizer.load_state_dict({"state": slots, "param_groups": groups})


def _crc32(tensors: dict[str, Tensor]) -> int:
    checksum = 0
    for name in sorted(tensors):
        checksum = zlib.crc32(tensors[name].numpy().tobytes(), zlib.crc32(name.encode(), checksum))
    return checksum
