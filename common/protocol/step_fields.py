"""The fields of a step, each declared once.

The chunk's codec, the ring's files and the contents of a minibatch follow from the declaration. To
add a field, add its line here, fill it in `actors.stream.chunker`, and use it.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from common.checked import MAX_SIZE
from common.protocol.message import Array, dtype_of

FRAME_SHAPE = (84, 84)
FRAME_BYTES = math.prod(FRAME_SHAPE)
"""Size of a frame; a step in a chunk has one frame and little else."""
MAX_ELAPSED = 255
"""Maximum number of agent steps of game time in a step."""


class StoredArray(Array):
    """An array of T steps that the ring keeps. If it is ``drawn``, minibatches carry it in
    `replay.batch.Batch.drawn`."""

    def __init__(self, *shape: int | str, drawn: bool = False, most: float | None = None) -> None:
        super().__init__("T", *shape, most=most)
        self.drawn = drawn


class Column(StoredArray):
    """An array of T steps that the ring keeps in a file of its own."""


class Flag(StoredArray):
    """Booleans of T steps that the ring keeps in ``bit`` of its file of flags; bit 8 is the ring's
    own."""

    def __init__(self, bit: int, *, drawn: bool = False) -> None:
        super().__init__(drawn=drawn)
        self.bit = bit


@dataclass(frozen=True)
class StepFields:
    """T consecutive steps of one environment, with vector observations of P components.

    The replay counts a field that is neither `Column` nor `Flag`, and does not keep it.
    """

    actions: Annotated[NDArray[np.uint8], Column()]
    frames: Annotated[NDArray[np.uint8], Column(*FRAME_SHAPE)]
    """Newest frame of each state."""
    rewards: Annotated[NDArray[np.float32], Column(most=MAX_SIZE)]
    terminated: Annotated[NDArray[np.bool_], Flag(1)]
    truncated: Annotated[NDArray[np.bool_], Flag(2)]
    elapsed: Annotated[NDArray[np.uint8], Column()]
    """Agent steps of game time that the step took: 1 unless the actor waits for its keys."""
    valid: Annotated[NDArray[np.bool_], Flag(4)]
    """Whether the state's newest frame shows the screen."""
    follows: Annotated[NDArray[np.bool_], Array("T")]
    """Whether the newest frame differs from the previous one, or the game's picture did not
    change."""
    matched: Annotated[NDArray[np.bool_], Array("T")]
    """Whether exactly the commanded keys were pressed at the step's end."""
    vectors: Annotated[NDArray[np.float32], Column("P", most=MAX_SIZE)]
    """Vector observation of each state; P may be 0."""


class StepField(NamedTuple):
    """The declaration of an array with one row per step."""

    dtype: np.dtype[Any]
    array: Array
    """Its shape, and where the ring keeps it."""

    def step_bytes(self, vector_width: int) -> int:
        """Returns the size of one step's values, bytes."""
        return math.prod(self.array.shape_for({"T": 1, "P": vector_width})) * self.dtype.itemsize


def step_fields(kind: type) -> dict[str, StepField]:
    """Returns the fields of ``kind`` that have one row per step, by name."""
    found: dict[str, StepField] = {}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        annotation, *metadata = get_args(hint) or (hint,)
        array = next((each for each in metadata if isinstance(each, Array)), None)
        if array is not None and array.shape[:1] == ("T",):
            found[name] = StepField(dtype_of(annotation), array)
    return found


STEP_FIELDS = step_fields(StepFields)


def drawn_fields() -> dict[str, StepField]:
    """Returns the step fields that minibatches carry unchanged."""
    return {
        name: field
        for name, field in STEP_FIELDS.items()
        if isinstance(field.array, StoredArray) and field.array.drawn
    }


def zero_steps(count: int, vector_width: int = 0) -> dict[str, NDArray[Any]]:
    """Returns ``count`` steps by field, all zeros, for callers that set only some fields."""
    sizes = {"T": count, "P": vector_width}
    return {
        name: np.zeros(field.array.shape_for(sizes), field.dtype)
        for name, field in STEP_FIELDS.items()
    }


def bit_of(name: str) -> int:
    """Returns the bit of the `Flag` called ``name``."""
    array = STEP_FIELDS[name].array
    assert isinstance(array, Flag)
    return array.bit
