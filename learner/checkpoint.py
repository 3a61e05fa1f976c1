"""The learner's whole state in one safetensors file: its algorithm's, and its counters as JSON.

There is no random state to keep: minibatches are drawn by a generator that the replay seeds anew at
each start, random shifts by one that is seeded with the updates so far, and the networks have no
noise of their own.
"""

import json
import os
import zlib
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from common.errors import InputError
from common.run.folder import write_atomically
from learner.algorithm.interface import Algorithm


def previous_of(path: Path) -> Path:
    """Where the checkpoint before the one at ``path`` is kept."""
    return path.with_name(f"{path.stem}.previous{path.suffix}")


def save_checkpoint(path: Path, algorithm: Algorithm, state: dict[str, Any]) -> None:
    """Write everything to ``path``, atomically; what was there becomes the previous one.

    Args:
        state: counters of the run, of JSON's types.
    """
    tensors = {name: value.detach().cpu().contiguous() for name, value in algorithm.state().items()}
    metadata = {"state": json.dumps(state), "crc32": str(_crc32(tensors))}
    content = save(tensors, metadata)
    if path.exists():
        # A link first, so that there is a checkpoint at `path` at every moment.
        kept = path.with_name(path.name + ".kept")
        kept.unlink(missing_ok=True)
        os.link(path, kept)
        kept.replace(previous_of(path))
    write_atomically(path, content)


def load_checkpoint(path: Path, algorithm: Algorithm) -> dict[str, Any]:
    """Puts the state at ``path`` into ``algorithm`` and returns the counters.

    Raises:
        InputError: the file is damaged, or of another algorithm, network or optimizer.
    """
    try:
        with safe_open(path, "pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        if metadata["crc32"] != str(_crc32(tensors)):
            raise ValueError("its checksum does not fit")
        state: dict[str, Any] = json.loads(metadata["state"])
        algorithm.load_state(tensors)
    except (SafetensorError, OSError, LookupError, ValueError, RuntimeError) as error:
        advice = "start the run anew under another name"
        if previous_of(path).exists():
            advice = f"copy {previous_of(path).name} over it to go on from the one before"
        raise InputError(f"the checkpoint {path} is damaged ({error}): {advice}.") from None
    return state


def _crc32(tensors: dict[str, Tensor]) -> int:
    checksum = 0
    for name in sorted(tensors):
        checksum = zlib.crc32(tensors[name].numpy().tobytes(), zlib.crc32(name.encode(), checksum))
    return checksum
