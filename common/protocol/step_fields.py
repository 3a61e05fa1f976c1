"""What there is to say of a step: the one declaration of each field.

The chunk's codec, the ring's files and what a minibatch carries follow from it. To add a field,
add its line here, fill it in `actors.stream.chunker`, and use it.
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
"""Bytes of one frame; a step in a chunk has one frame and little else."""


class StoredArray(Array):
    """An array of T steps that the ring keeps, and, if it is ``drawn``, minibatches carry in
    `replay.batch.Batch.drawn`."""

    def __init__(self, *shape: int | str, drawn: bool = False, most: float | None = None) -> None:
        super().__init__("T", *shape, most=most)
        self.drawn = drawn


class Column(StoredArray):
    """An array of T steps that the ring keeps in a file of its own."""


class Flag(StoredArray):
    """Booleans of T steps that the ring keeps in ``bit`` of its file of flags; 8 is its own."""

    def __init__(self, bit: int, *, drawn: bool = False) -> None:
        super().__init__(drawn=drawn)
        self.bit = bit


@dataclass(frozen=True)
class StepFields:
    """T consecutive steps of one environment; P numbers make a vector observation.

    A field that is neither `Column` nor `Flag` is counted by the replay and not kept.
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
    """The state's newest frame was really seen."""
    follows: Annotated[NDArray[np.bool_], Array("T")]
    """The newest frame differs from the one before, or the game's own picture did not change."""
    matched: Annotated[NDArray[np.bool_], Array("T")]
    """The keys pressed at the step's end were the commanded ones."""
    vectors: Annotated[NDArray[np.float32], Column("P", most=MAX_SIZE)]
    """Vector observation of each state; P may be 0."""


class StepField(NamedTuple):
    """What is declared of an array with a row for each step."""

    dtype: np.dtype[Any]
    array: Array
    """Its shape, and where the ring keeps it."""

    def step_bytes(self, vector_width: int) -> int:
        """Returns the size of one step's values."""
        return math.prod(self.array.shape_for({"T": 1, "P": vector_width})) * self.dtype.itemsize


def step_fields(kind: type) -> dict[str, StepField]:
    """Returns the fields of ``kind`` that have one row for each step, by name."""
    found: dict[str, StepField] = {}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        annotation, *metadata = get_args(hint) or (hint,)
        array = next((each for each in metadata if isinstance(each, Array)), None)
        if array is not None and array.shape[:1] == ("T",):
            found[name] = StepField(dtype_of(annotation), array)
    return found


STEP_FIELDS = step_fields(StepFields)


def drawn_fields() -> dict[str, StepField]:
    """Returns the step fields that minibatches carry as they are."""
    return {
        name: field
        for name, field in STEP_FIELDS.items()
        if isinstance(field.array, StoredArray) and field.array.drawn
    }


def zero_steps(count: int, vector_width: int = 0) -> dict[str, NDArray[Any]]:
    """Returns ``count`` steps by field, all zeros, for those that set only the fields they need."""
    sizes = {"T": count, "P": vector_width}
    return {
        name: np.zeros(field.array.shape_for(sizes), field.dtype)
        for name, field in STEP_FIELDS.items()
    }


def bit_of(name: str) -> int:
    """Returns the bit of a `Flag` of the table."""
    array = STEP_FIELDS[name].array
    assert isinstance(array, Flag)
    return array.bit
