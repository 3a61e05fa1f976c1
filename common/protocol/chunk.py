"""A chunk: T consecutive steps of one environment's stream, the unit that actors send.

It stands alone. Its ``context`` frames stack its first states; later chunks of the same stream
complete its last n-step returns. Each frame travels once, but for the context (at most
``frame_stack - 1`` frames), which the replay stores only where the chunk before is missing.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.errors import MessageError
from common.protocol.wire import pack, pack_array, take, take_array, unpack
from common.run.config import MAX_CHUNK_STEPS, MAX_FRAME_STACK

FRAME_SHAPE = (84, 84)
MAX_CONTEXT = MAX_FRAME_STACK - 1
MAX_VECTOR = 1_024


class Game(NamedTuple):
    """One whole game, from reset to game over, whatever episodes the learner saw in it."""

    score: float
    steps: int


@dataclass(frozen=True)
class Chunk:
    """Steps ``t = 0 … T-1``; the episode goes on from the chunk before unless ``context`` is 0."""

    run: str
    actor: str
    incarnation: int
    """Differs for each start of the actor's process, so that its sequence numbers may restart."""
    stream: int
    """Which of the actor's environments."""
    sequence: int
    """0, 1, 2 … for each stream of an incarnation."""
    weights_version: int
    epsilon: float
    context: NDArray[np.uint8]
    """Frames before step 0 of its episode, oldest first, ``[C, 84, 84]``, C < frame_stack."""
    frames: NDArray[np.uint8]
    """Newest frame of each state, ``[T, 84, 84]``."""
    actions: NDArray[np.uint8]
    rewards: NDArray[np.float32]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    elapsed: NDArray[np.uint8]
    """Decisions of game time the step took (1 unless the actor waits for its keys), ``[T]``."""
    valid: NDArray[np.bool_]
    """The state's newest frame was really seen, ``[T]``."""
    matched: NDArray[np.bool_]
    """The keys pressed at the step's end were the commanded ones, ``[T]``."""
    explored: NDArray[np.bool_]
    """The action was random, ``[T]``."""
    vectors: NDArray[np.float32]
    """Vector observation of each state, ``[T, P]``; P may be 0."""
    final_frames: NDArray[np.uint8]
    """Frame after each truncated step, in order, ``[truncated.sum(), 84, 84]``."""
    final_vectors: NDArray[np.float32]
    """Vector observation after each truncated step, ``[truncated.sum(), P]``."""
    games: tuple[Game, ...] = ()
    """Games that ended within the chunk."""

    def __len__(self) -> int:
        return len(self.actions)


_SCALARS = ("run", "actor", "incarnation", "stream", "sequence", "weights_version", "epsilon")
_ARRAYS = (
    "context",
    "frames",
    "actions",
    "rewards",
    "terminated",
    "truncated",
    "elapsed",
    "valid",
    "matched",
    "explored",
    "vectors",
    "final_frames",
    "final_vectors",
)


def encode_chunk(chunk: Chunk) -> bytes:
    """The chunk as one msgpack message."""
    message: dict[str, Any] = {name: getattr(chunk, name) for name in _SCALARS}
    message |= {name: pack_array(getattr(chunk, name)) for name in _ARRAYS}
    return pack({**message, "games": [list(game) for game in chunk.games]})


def decode_chunk(payload: bytes) -> Chunk:
    """The chunk inside ``payload``; its arrays are read-only views of the payload.

    Raises:
        MessageError: anything a well-behaved actor would not send.
    """
    message = unpack(payload)
    actions = take_array(message, "actions", np.uint8, (None,))
    steps = len(actions)
    if not 1 <= steps <= MAX_CHUNK_STEPS:
        raise MessageError(f"{steps} steps where 1 to {MAX_CHUNK_STEPS} are allowed")
    vectors = take_array(message, "vectors", np.float32, (steps, None))
    width = vectors.shape[1]
    truncated = take_array(message, "truncated", np.bool_, (steps,))
    finals = int(np.count_nonzero(truncated))
    context = take_array(message, "context", np.uint8, (None, *FRAME_SHAPE))
    chunk = Chunk(
        run=take(message, "run", str),
        actor=take(message, "actor", str),
        incarnation=take(message, "incarnation", int, 0),
        stream=take(message, "stream", int, 0),
        sequence=take(message, "sequence", int, 0),
        weights_version=take(message, "weights_version", int, 0),
        epsilon=take(message, "epsilon", float, 0.0),
        context=context,
        frames=take_array(message, "frames", np.uint8, (steps, *FRAME_SHAPE)),
        actions=actions,
        rewards=take_array(message, "rewards", np.float32, (steps,)),
        terminated=take_array(message, "terminated", np.bool_, (steps,)),
        truncated=truncated,
        elapsed=take_array(message, "elapsed", np.uint8, (steps,)),
        valid=take_array(message, "valid", np.bool_, (steps,)),
        matched=take_array(message, "matched", np.bool_, (steps,)),
        explored=take_array(message, "explored", np.bool_, (steps,)),
        vectors=vectors,
        final_frames=take_array(message, "final_frames", np.uint8, (finals, *FRAME_SHAPE)),
        final_vectors=take_array(message, "final_vectors", np.float32, (finals, width)),
        games=take_games(message, steps),
    )
    if len(context) > MAX_CONTEXT:
        raise MessageError(f"{len(context)} context frames where {MAX_CONTEXT} are allowed")
    if width > MAX_VECTOR:
        raise MessageError(f"vectors of {width} numbers where {MAX_VECTOR} are allowed")
    if not (np.isfinite(chunk.rewards).all() and np.isfinite(vectors).all()):
        raise MessageError("rewards and vectors should be finite")
    if not np.isfinite(chunk.final_vectors).all():
        raise MessageError("final vectors should be finite")
    if (chunk.terminated & truncated).any():
        raise MessageError("a step cannot be both terminated and truncated")
    if chunk.epsilon > 1:
        raise MessageError(f"epsilon is {chunk.epsilon}")
    if not (chunk.elapsed >= 1).all():
        raise MessageError("a step takes at least one decision")
    for name in ("terminated", "truncated", "valid", "matched", "explored"):
        if getattr(chunk, name).view(np.uint8).max() > 1:
            raise MessageError(f"{name} should be booleans")
    return chunk


def take_games(message: dict[str, Any], most: int) -> tuple[Game, ...]:
    """Field ``games``: a list of scores and steps.

    Raises:
        MessageError: it is not, or longer than ``most``.
    """
    games = message.get("games")
    if not isinstance(games, list) or len(games) > most:
        raise MessageError(f"games should be a list, of {most} games at most")
    for game in games:
        if (
            not isinstance(game, list)
            or [type(value) for value in game] != [float, int]
            or not np.isfinite(game[0])
            or not 0 <= game[1] < 2**31
        ):
            raise MessageError(f"{game!r} is not a game's score and steps")
    return tuple(Game(score, length) for score, length in games)
