"""The file of a latency model, in the format that Physical Atari publishes.

Keen Technologies' repository physical-atari-rlc (Apache 2.0) has such a file for its own robot,
``agent_code/sim_env/robotroller_model_weights.npz``. A file may also hold several copies of the
same hands: each array then has a first axis more, of the copies. Users bring the file, so its
content is not trusted.
"""

import io
import reprlib
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.actions import KEYS_OF_ACTION
from common.atomic_file import write_atomically
from common.checked import MAX_SIZE
from common.errors import InputError
from common.pinned_file import MAX_BYTES, path_of, read
from common.settings.conditions import PlayConfig

ACTIONS = len(KEYS_OF_ACTION)
COMMANDS = 30
"""Commands that the model remembers."""
ROW = 2 * ACTIONS
"""Numbers per command."""
MAX_HIDDEN = 4_096
MAX_COPIES = 16
MAX_UNITS = (MAX_BYTES - 2**12) // (4 * (COMMANDS * ROW + 1 + ACTIONS))
"""Maximum number of hidden units of all copies in a file, beside 4 KiB of headers and biases."""
_NAMED = 6
"""Maximum number of wrong members that an error names."""
_MEMBERS = ("fc_weight", "fc_bias", "pred_weight", "pred_bias")


@dataclass(frozen=True)
class ModelWeights:
    """Two dense layers of ``H`` hidden units, ``float64``."""

    fc_weight: NDArray[np.float64]
    """``[H, 30 × 36]``, the oldest command first."""
    fc_bias: NDArray[np.float64]
    """``[H]``."""
    pred_weight: NDArray[np.float64]
    """``[18, H]``, a row for each of ALE's actions."""
    pred_bias: NDArray[np.float64]
    """``[18]``."""

    def __post_init__(self) -> None:
        """Raises ValueError for arrays of other types, sizes or magnitudes."""
        hidden = len(self.fc_bias) if self.fc_bias.ndim == 1 else 0
        if not 1 <= hidden <= MAX_HIDDEN:
            raise ValueError(
                f"fc_bias has shape {list(self.fc_bias.shape)} where [H] is expected, "
                f"H from 1 to {MAX_HIDDEN:,}"
            )
        shapes = ((hidden, COMMANDS * ROW), (hidden,), (ACTIONS, hidden), (ACTIONS,))
        for field, shape in zip(fields(self), shapes, strict=True):
            array = getattr(self, field.name)
            if array.dtype.kind != "f":
                raise ValueError(f"{field.name} has type {array.dtype} where floats are expected")
            if array.shape != shape:
                raise ValueError(
                    f"{field.name} has shape {list(array.shape)} where {list(shape)} is expected"
                )
            numbers = array.astype(np.float64)
            if not (np.abs(numbers) <= MAX_SIZE).all():
                raise ValueError(f"{field.name} holds a number that is not within ±{MAX_SIZE:g}")
            object.__setattr__(self, field.name, numbers)


def read_copies(name: str) -> list[ModelWeights]:
    """Returns the weights of each copy in the file that ``name`` stands for (see
    `common.pinned_file`); a file of the published format holds one.

    Raises:
        InputError: the file cannot be read, is not the run's, or holds no latency model.
    """
    content = read(name)
    try:
        arrays = _arrays(content)
        if arrays["fc_weight"].ndim <= 2:
            return [ModelWeights(**arrays)]
        counts = {len(each) if each.ndim else 0 for each in arrays.values()}
        if len(counts) > 1 or not 1 <= min(counts) <= MAX_COPIES:
            raise ValueError(
                f"its arrays are of {', '.join(map(str, sorted(counts)))} copies where the same "
                f"number is expected, from 1 to {MAX_COPIES}"
            )
        return [
            ModelWeights(**dict(zip(arrays, copy, strict=True)))
            for copy in zip(*arrays.values(), strict=True)
        ]
    except Exception as error:  # what a damaged archive raises depends on where it is damaged
        raise InputError(
            f"{path_of(name)} holds no latency model ({error}): name an .npz file of Physical "
            f"Atari's format, with the arrays {', '.join(_MEMBERS)}."
        ) from None


def read_weights(name: str) -> ModelWeights:
    """Returns the weights in a file of one copy. Raises InputError as `read_copies` does, and for a
    file of several, none of which is the hands'."""
    weights, *others = read_copies(name)
    if others:
        raise InputError(
            f"{path_of(name)} holds {1 + len(others)} copies of the hands where one is needed: "
            "make one by python -m actors.robots.latency_model.fit --copies 1."
        )
    return weights


def check_one_copy(play: PlayConfig) -> None:
    """Refuses hands of which there are several copies, where one pair of hands is measured. Raises
    InputError as `read_weights` does."""
    if play.latency_model:
        read_weights(play.latency_model)


def write_copies(file: Path, copies: Sequence[ModelWeights]) -> None:
    """Writes the file of a model, in float32 as Physical Atari's; a single copy in their format."""
    arrays: dict[str, Any] = {
        name: np.stack([vars(copy)[name] for copy in copies]).astype(np.float32)
        for name in _MEMBERS
    }
    if len(copies) == 1:
        arrays = {name: each[0] for name, each in arrays.items()}
    content = io.BytesIO()
    np.savez(content, **arrays)
    write_atomically(file, content.getvalue())


def _arrays(content: bytes) -> dict[str, NDArray[np.float64]]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        sizes = {each.filename: each.file_size for each in archive.infolist()}
    if sizes.keys() != {f"{name}.npy" for name in _MEMBERS}:
        # Names are not trusted either: a file may hold a million, or line breaks in them.
        named = ", ".join(reprlib.repr(name) for name in sorted(sizes)[:_NAMED])
        more = f" and {len(sizes) - _NAMED} more" if len(sizes) > _NAMED else ""
        raise ValueError(f"its members are {named or 'none'}{more}")
    if sum(sizes.values()) > MAX_BYTES:
        raise ValueError(f"unpacked it is larger than {MAX_BYTES:,} bytes")
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        return {name: arrays[name] for name in _MEMBERS}
