"""Vectors travel beside the frames, and chunks alone give them back."""

from typing import Any

import gymnasium
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from actors.loop import play
from actors.policy import Policy
from actors.stream.chunker import Chunker
from common.network import QNetwork
from common.protocol.chunk import Chunk
from tests.actors.numbered_env import CUT, GAME_OVER, GOES_ON, LOSES_A_LIFE, NumberedEnv

WIDTH = 3


def vector_of(frames: NDArray[np.uint8]) -> NDArray[np.float32]:
    """A vector that belongs to a state and to no other."""
    number = int(np.frombuffer(frames[-1][0, :4].tobytes(), np.uint32)[0])
    return np.array([number, -number, 0.5], np.float32)


class VectorEnv(gymnasium.ObservationWrapper[Any, Any, Any]):
    def observation(self, observation: NDArray[np.uint8]) -> dict[str, Any]:
        return {"frames": observation, "vector": vector_of(observation)}


class Watcher(Policy):
    """Acts at random, and checks what it is shown."""

    def __init__(self) -> None:
        super().__init__(QNetwork(6, 4, WIDTH), 6, np.random.default_rng(0), envs=2)

    def act(self, frames: NDArray[np.uint8], vectors: NDArray[np.float32]) -> NDArray[np.int64]:
        for state, vector in zip(frames, vectors, strict=True):
            assert (vector == vector_of(state)).all()
        return super().act(frames, vectors)


@settings(max_examples=40)
@given(
    st.lists(
        st.sampled_from([GOES_ON, GOES_ON, LOSES_A_LIFE, GAME_OVER, CUT]), min_size=1, max_size=20
    ),
    st.integers(1, 30),
    st.integers(1, 9),
)
def test_every_chunk_has_the_vectors_of_its_own_states(
    script: list[str], turns: int, length: int
) -> None:
    inner = [NumberedEnv(script), NumberedEnv(script, first=5_000)]
    policy = Watcher()
    chunkers = [Chunker("run", "actor", 7, i, length) for i in range(2)]
    chunks: list[list[Chunk]] = [[], []]
    steps = play([VectorEnv(env) for env in inner], policy, [0, 0])
    for at, step in enumerate(steps, start=1):
        chunk = chunkers[step.stream].add(step)
        if chunk is not None:
            chunks[step.stream].append(chunk)
        if at == 2 * turns:
            break
    for stream, chunker in enumerate(chunkers):
        rest = chunker.cut()
        if rest is not None:
            chunks[stream].append(rest)
        moments = inner[stream].moments
        received = [Chunk.decode(chunk.encode()) for chunk in chunks[stream]]
        vectors = np.concatenate([chunk.vectors for chunk in received])
        assert vectors.tolist() == [vector_of(moment.state).tolist() for moment in moments]
        finals = np.concatenate([chunk.final_vectors for chunk in received])
        cut = [moment for moment in moments if moment.ending == CUT]
        assert finals.tolist() == [vector_of(moment.next_state).tolist() for moment in cut]
