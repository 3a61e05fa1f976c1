"""The learner's whole state in one safetensors file: the algorithm's tensors, and counters as JSON.

There is no random state to keep. The replay seeds the generator of minibatches at each start, the
generator of random shifts is seeded with the number of updates, and the networks have no noise of
their own.
"""

import errno
import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from common.atomic_file import has_room, write_atomically
from common.crc32 import crc32
from common.errors import InputError
from common.run.origin import origin_metadata
from common.settings.config import RunConfig
from learner.algorithm.interface import Algorithm

_ROOM = 2
"""Number of checkpoints that the disk should have room for; tables and snapshots are smaller."""


class Checkpoint:
    """The checkpoint of a run at ``path``, and the one before it at ``previous``.

    Args:
        algorithm: the algorithm whose state is saved and restored.
        config: the run's configuration.
    """

    def __init__(self, path: Path, previous: Path, algorithm: Algorithm, config: RunConfig) -> None:
        self.path = path
        self.previous = previous
        self.damaged = path.with_suffix(".damaged")
        self._algorithm = algorithm
        self._origin = origin_metadata(config)

    def save(self, state: dict[str, Any]) -> None:
        """Writes the checkpoint atomically; the one that was there becomes the previous one.

        Args:
            state: the run's counters, of JSON's types.
        """
        tensors = {
            name: value.detach().cpu().contiguous()
            for name, value in self._algorithm.state().items()
        }
        metadata = {**self._origin, "state": json.dumps(state)}
        metadata["checksum"] = str(_crc32(tensors, metadata["state"]))
        write_atomically(self.path, save(tensors, metadata), self.previous)

    def load(self, say: Callable[[str], None]) -> dict[str, Any]:
        """Loads the newest intact checkpoint into the algorithm; returns the counters.

        Args:
            say: takes a sentence for people.

        Raises:
            InputError: no file is intact, or it belongs to another network or optimizer.
        """
        try:
            tensors, state = _read(self.path)
        except _DAMAGE as error:
            try:
                tensors, state = _read(self.previous)
            except _DAMAGE:
                raise InputError(
                    f"the checkpoint {self.path} is damaged or missing ({error}), and so is "
                    f"{self.previous.name}, the one before: put one back from a backup, or begin "
                    "another run."
                ) from None
            if self.path.exists():
                self.path.replace(self.damaged)
            self.previous.replace(self.path)  # or the next save would drop the intact one
            say(
                f"WARNING: the checkpoint {self.path} is damaged or missing ({error}): the run "
                f"goes on from {self.previous.name}, the one before."
            )
        try:
            self._algorithm.load_state(tensors)
        except (LookupError, ValueError, RuntimeError) as error:
            raise InputError(
                f"the checkpoint {self.path} belongs to another network or optimizer ({error}): "
                "give the run the settings that it was made with."
            ) from None
        return state

    @contextmanager
    def restoring(self) -> Iterator[None]:
        """Within it, the counters that `load` returned are taken up.

        Raises:
            InputError: they are not of the form that `save` writes, for the file was changed.
        """
        try:
            yield
        except (AttributeError, LookupError, OverflowError, TypeError, ValueError) as error:
            raise InputError(
                f"the counters in the checkpoint {self.path} are not those of a run "
                f"({type(error).__name__}: {error}): put the file back from a backup."
            ) from None

    def check_room(self) -> None:
        """Checks that the disk has room for the next checkpoint.

        Raises:
            OSError: the disk is full or read-only; the same error as from a write.
        """
        folder = self.path.parent
        # If somebody removed the checkpoint, a new one must not be held up.
        needed = _ROOM * self.path.stat().st_size if self.path.exists() else 0
        if os.statvfs(folder).f_flag & os.ST_RDONLY:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(folder))
        if not has_room(folder, needed):
            needs = f"{os.strerror(errno.ENOSPC)}; it needs {-(-needed // 2**20)} MiB"
            raise OSError(errno.ENOSPC, needs, str(folder))


_DAMAGE = (SafetensorError, FileNotFoundError, LookupError, ValueError, RecursionError)
"""Errors that reading a damaged or missing file raises."""


def _read(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Returns tensors and counters of an intact checkpoint; raises one of `_DAMAGE` otherwise."""
    if path.exists() and not path.is_file():
        raise ValueError("it is not a regular file")
    with safe_open(path, "pt") as file:
        metadata = file.metadata() or {}
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    if "checksum" in metadata:
        whole = metadata["checksum"] == str(_crc32(tensors, metadata["state"]))
    else:  # former versions left the counters out of the checksum
        whole = metadata["crc32"] == str(_crc32(tensors))
    if not whole:
        raise ValueError("its checksum does not match")
    state = json.loads(metadata["state"])
    if not isinstance(state, dict):
        raise ValueError("its counters are not a table")
    return tensors, state


def counters_of(content: bytes) -> dict[str, Any]:
    """Returns agent steps, updates and seconds of training until the checkpoint with this
    ``content``, which is safetensors; none if it does not tell them. Raises LookupError, TypeError
    or ValueError if they are damaged."""
    # safetensors reads metadata from files only, and the file may be another one by now.
    size = int.from_bytes(content[:8], "little")
    told = json.loads(content[8 : 8 + size]).get("__metadata__", {})
    if "state" not in told:
        return {}
    state = json.loads(told["state"])
    return {
        "agent_steps": state["books"]["agent_steps"],
        "updates": state["updates"],
        "wall_seconds": state["seconds"],
    }


def _crc32(tensors: dict[str, Tensor], text: str = "") -> int:
    checksum = crc32(text.encode())
    for name in sorted(tensors):
        checksum = crc32(tensors[name].numpy().tobytes(), crc32(name.encode(), checksum))
    return checksum
