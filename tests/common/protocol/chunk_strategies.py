"""Hypothesis strategies for chunks as well-behaved actors send them."""

from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from common.checked import NAME
from common.protocol.chunk import Chunk, Game
from common.protocol.step_fields import FRAME_SHAPE, zero_steps

NAMES = st.from_regex(NAME, fullmatch=True)
COUNTS = st.integers(0, 2**63 - 1)
SHARES = st.floats(0, 1)
SCORES = st.floats(-1e6, 1e6)


@st.composite
def chunks(draw: st.DrawFn, most_steps: int = 12) -> Chunk:
    """Any valid chunk of up to ``most_steps`` steps."""
    steps = draw(st.integers(1, most_steps))
    width = draw(st.integers(0, 5))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    ends = np.array(draw(st.lists(st.sampled_from("-xt"), min_size=steps, max_size=steps)))
    finals = int((ends == "t").sum())

    levels = draw(st.sampled_from([256, 2]))  # of grey; 256 of noise cannot be compressed

    def frames(count: int) -> NDArray[np.uint8]:
        return rng.integers(levels, size=(count, *FRAME_SHAPE), dtype=np.uint8)

    def floats(*shape: int) -> NDArray[np.float32]:
        return rng.normal(scale=100, size=shape).astype(np.float32)

    def noise(like: NDArray[Any]) -> NDArray[Any]:
        """Random values of a field that has no rule of its own."""
        if like.dtype == np.bool_:
            return rng.random(like.shape) < 0.5
        if like.dtype == np.uint8:
            return rng.integers(256, size=like.shape, dtype=np.uint8)
        return floats(*like.shape).astype(like.dtype)

    games = draw(st.lists(st.tuples(SCORES, st.integers(0, 2**31 - 1)), max_size=steps))
    return Chunk(
        run_id=draw(NAMES),
        actor=draw(NAMES),
        incarnation=draw(COUNTS),
        stream=draw(COUNTS),
        sequence=draw(COUNTS),
        weights_version=draw(COUNTS),
        epsilon=draw(SHARES),
        context=frames(draw(st.integers(0, 15))),
        **{name: noise(zeros) for name, zeros in zero_steps(steps, width).items()}
        | {
            "actions": rng.integers(18, size=steps, dtype=np.uint8),
            "terminated": ends == "x",
            "truncated": ends == "t",
            "elapsed": rng.integers(1, 256, size=steps).astype(np.uint8),
        },
        final_frames=frames(finals),
        final_vectors=floats(finals, width),
        games=tuple(Game(*game) for game in games),
    )


def example_chunk(**changes: Any) -> Chunk:
    """Three steps, of which the last is truncated; ``changes`` replace fields."""
    fields: dict[str, Any] = {
        "run_id": "run-id",
        "actor": "actor",
        "incarnation": 17,
        "stream": 0,
        "sequence": 3,
        "weights_version": 5,
        "epsilon": 0.25,
        "context": np.full((2, 84, 84), 1, np.uint8),
        "frames": np.full((3, 84, 84), 2, np.uint8),
        "actions": np.array([0, 17, 4], np.uint8),
        "rewards": np.array([0.0, -1.5, 21.0], np.float32),
        "terminated": np.array([False, False, False]),
        "truncated": np.array([False, False, True]),
        "elapsed": np.array([1, 1, 255], np.uint8),
        "valid": np.array([True, False, True]),
        "follows": np.array([True, True, False]),
        "matched": np.array([False, True, True]),
        "vectors": np.arange(6, dtype=np.float32).reshape(3, 2),
        "final_frames": np.full((1, 84, 84), 3, np.uint8),
        "final_vectors": np.array([[8.0, 9.0]], np.float32),
        "games": (Game(-21.0, 764),),
    }
    return Chunk(**(zero_steps(3, 2) | fields | changes))


def same(one: Chunk, other: Chunk) -> bool:
    """All fields are equal, dtypes included."""
    for name, value in vars(one).items():
        found = getattr(other, name)
        if isinstance(value, np.ndarray):
            if value.dtype != found.dtype or not np.array_equal(value, found):
                return False
        elif type(value) is not type(found) or value != found:
            return False
    return True
