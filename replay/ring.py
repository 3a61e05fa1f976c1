"""The ring: each frame once, and the links from which states and returns are assembled.

Every frame has an id and lies in slot ``id % capacity``; ids count up for ever. Ids from ``tail``
to ``head`` are alive. An older id is recognised as such, whatever its slot holds now. A chunk takes
consecutive ids: context frames (only if the previous chunk is not there to lend its own), its
steps, then the true final frames of its truncated steps.

Two links per slot make every walk a fixed number of array look-ups, without special cases:

* ``previous``: the frame before. The first frame of an episode links to itself, so it is repeated
  when a state is stacked there.
* ``next``: the frame one step later. A terminated step links to itself, with a discount of 0. A
  truncated step links to its final frame, and that to itself, with a reward of 0 after 0 agent
  steps. The newest step of a stream has -1 until the next chunk comes.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.crc32 import crc32
from common.protocol.chunk import Chunk
from common.protocol.step_fields import STEP_FIELDS, Column, Flag, bit_of, drawn_fields
from common.settings.config import RunConfig
from replay.batch import Batch, SharedBatch
from replay.columns import Columns
from replay.samplers import Ids

TERMINATED, TRUNCATED, VALID = map(bit_of, ("terminated", "truncated", "valid"))
STEP = 8
"""Bit of the flags: the slot holds a step, not a context frame or a final frame."""

_BLOCK = 65_536
"""Number of ids that are followed at a time: those of a whole ring take 100 MB."""


class Placement(NamedTuple):
    """The place of a chunk in the ring."""

    base: int
    """Id of its first frame."""
    context: int
    """Number of stored context frames."""
    steps: int
    finals: int
    """Number of true final frames, of its truncated steps."""
    previous: int
    """Id of the step before, whose frames the chunk shares; -1 if it shares none."""
    crc: int = -1
    """CRC-32 of its rows, column by column; -1 in journals that were written without one."""

    @property
    def first(self) -> int:
        """Id of its first step."""
        return self.base + self.context

    @property
    def last(self) -> int:
        """Id of its last step."""
        return self.first + self.steps - 1

    @property
    def end(self) -> int:
        """Id of the first frame after it."""
        return self.first + self.steps + self.finals


class Ring:
    """The stored chunks, from which transitions are read."""

    def __init__(self, columns: Columns, config: RunConfig) -> None:
        self.head = 0
        """The next id."""
        self.tail = 0
        """The oldest id alive."""
        self._columns = columns
        self._rows = columns.rows
        self._drawn = tuple(drawn_fields())
        self._capacity = columns.capacity
        self._frame_stack = config.play.frame_stack
        self._n_step = config.learning.n_step
        self._clip_rewards = config.learning.clip_rewards
        self._losses_end = config.learning.losses_end_returns
        self._previous = np.full(columns.capacity, -1, np.int64)
        self._next = np.full(columns.capacity, -1, np.int64)
        self._discounts = config.learning.discount ** np.arange(256, dtype=np.float64)
        """γ to the power of 0 … 255 agent steps."""

    def write(self, placement: Placement, chunk: Chunk) -> Placement:
        """Writes the chunk's data to its slots, which must not belong to ids alive. Returns the
        placement with the data's checksum."""
        columns = self._columns
        flags = np.full(placement.steps, STEP, np.uint8)
        columns_of = {"flags": flags}
        for name, field in STEP_FIELDS.items():
            values = getattr(chunk, name)
            if isinstance(field.array, Flag):
                flags[values] |= field.array.bit
            elif isinstance(field.array, Column):
                columns_of[name] = values
        crc = 0
        for name, values in columns_of.items():
            finals = getattr(chunk, f"final_{name}", None)
            if finals is None:
                full = np.zeros((placement.end - placement.base, *values.shape[1:]), values.dtype)
                full[placement.context : placement.context + placement.steps] = values
                parts = [full]
            else:
                context = chunk.context if name == "frames" and placement.context else values[:0]
                parts = [context, values, finals]
            row = self._begin(name, placement)
            for part in parts:
                columns.write(name, row, part)
                row += len(part)
                crc = crc32(np.ascontiguousarray(part).reshape(-1).view(np.uint8).data, crc)
        return placement._replace(crc=crc)

    def is_whole(self, placement: Placement) -> bool:
        """Whether the rows of a chunk are as they were written."""
        crc = 0
        for name in ("flags", *(name for name in STEP_FIELDS if name in self._rows)):
            ids = np.arange(self._begin(name, placement), placement.end)
            rows = self._rows[name].take(ids % self._capacity, axis=0)
            crc = crc32(rows.reshape(-1).view(np.uint8).data, crc)
        return placement.crc in (crc, -1)

    def _begin(self, name: str, placement: Placement) -> int:
        """Returns the id of a chunk's first row in a column; vectors have no rows for a context."""
        shared = name != "frames" and f"final_{name}" in Chunk.__dataclass_fields__
        return placement.first if shared else placement.base

    def link(self, placement: Placement) -> None:
        """Sets the links within a written chunk, and back to the step that it continues."""
        context, last = placement.context, placement.context + placement.steps - 1
        ids = np.arange(placement.base, placement.end)
        slots = ids % self._capacity
        flags = self._rows["flags"][slots]
        previous, following = ids - 1, ids + 1
        previous[0] = placement.previous if placement.previous >= 0 else ids[0]
        following[:context] = ids[:context]
        begins = np.flatnonzero(flags[context:last] & (TERMINATED | TRUNCATED)) + context + 1
        previous[begins] = ids[begins]
        following[last] = -1
        terminated = np.flatnonzero(flags & TERMINATED)
        following[terminated] = ids[terminated]
        following[last + 1 :] = ids[last + 1 :]
        truncated = np.flatnonzero(flags & TRUNCATED)
        following[truncated] = ids[last + 1 :]
        previous[last + 1 :] = ids[truncated]
        self._previous[slots] = previous
        self._next[slots] = following

    def cut(self, placement: Placement) -> None:
        """Notes that the earlier frames that a linked chunk shares are lost."""
        self._previous[placement.base % self._capacity] = -1

    def join(self, before: Placement, after: Placement) -> None:
        """Links the last step of ``before`` to the first of ``after``, the next chunk of its
        stream, if that continues the episode."""
        if self.is_open(before) and (after.context or after.previous >= 0):
            self._next[before.last % self._capacity] = after.first

    def is_open(self, placement: Placement) -> bool:
        """Whether the chunk's last step does not end its episode."""
        flags = int(self._rows["flags"][placement.last % self._capacity])
        return not flags & (TERMINATED | TRUNCATED)

    def can_lend(self, last: int) -> bool:
        """Whether the step after ``last`` could be stacked from the frames before it."""
        frame = last
        for _ in range(self._frame_stack - 2):
            if frame < self.tail:
                return False
            frame = int(self._previous[frame % self._capacity])
        return frame >= self.tail

    def is_complete(self, ids: Ids) -> NDArray[np.bool_]:
        """Returns which of ``ids`` are steps whose frames, to the end of the return, are all
        alive."""
        complete = (self._rows["flags"][ids % self._capacity] & STEP) > 0
        for at in range(0, len(ids), _BLOCK):
            block = slice(at, at + _BLOCK)
            path, stacks = self._path_and_stacks(ids[block])
            complete[block] &= (path >= self.tail).all(axis=0)
            complete[block] &= (stacks.reshape(2, -1, self._frame_stack) >= self.tail).all(
                axis=(0, 2)
            )
        return complete

    def all_seen(self, ids: Ids) -> NDArray[np.bool_]:
        """Returns which of the complete steps ``ids`` have a state of valid frames only."""
        flags = self._rows["flags"][self._stacks(ids) % self._capacity]
        return np.asarray(((flags & VALID) > 0).all(axis=1))

    def states(self, ids: Ids) -> tuple[NDArray[np.uint8], NDArray[np.float32]] | None:
        """Returns frames ``[B, H, 84, 84]`` and vectors ``[B, P]`` of complete steps; None as in
        `read`."""
        stacks = self._stacks(ids)
        states = self._frames(stacks), self._rows["vectors"][ids % self._capacity]
        return states if self._are_alive(stacks) else None

    def read(self, ids: Ids, weights: NDArray[np.float32]) -> Batch | None:
        """Returns the transitions from complete steps ``ids``; None if one was evicted meanwhile.

        It needs no lock. An id's slot is overwritten only after ``tail`` has passed the id, so if
        all ids on the way are alive afterwards, everything that was read belonged to them.
        """
        path, stacks = self._path_and_stacks(ids)
        frames = self._frames(stacks)
        count = len(ids)
        batch = Batch(s_tm1=frames[:count], s_t=frames[count:], **self._rest(path, weights))
        return batch if self._are_alive(path) and self._are_alive(stacks) else None

    def read_shared(self, ids: Ids, weights: NDArray[np.float32]) -> SharedBatch | None:
        """Returns what `read` returns, with each frame once."""
        path, stacks = self._path_and_stacks(ids)
        once, places = np.unique(stacks, return_inverse=True)
        batch = SharedBatch(
            frames=self._frames(once),
            stacks=places.astype(np.int32).reshape(2, len(ids), self._frame_stack),
            **self._rest(path, weights),
        )
        return batch if self._are_alive(path) and self._are_alive(stacks) else None

    def _path_and_stacks(self, ids: Ids) -> tuple[Ids, Ids]:
        """Returns the path from ``ids``, and the stacks of the first and of the last states on
        it."""
        path = self._path(ids)
        return path, self._stacks(np.concatenate([path[0], path[-1]]))

    def _are_alive(self, ids: Ids) -> bool:
        return bool((ids >= self.tail).all())

    def _rest(self, path: Ids, weights: NDArray[np.float32]) -> dict[str, Any]:
        """Returns the fields of a batch without its states."""
        slots = path % self._capacity
        rows = self._rows
        rewards = rows["rewards"][slots[:-1]].astype(np.float64)
        if self._clip_rewards:
            # Rewards are clipped per agent step, and a step may sum those of several.
            most = rows["elapsed"][slots[:-1]].astype(np.float64)
            rewards = rewards.clip(-most, most)
        going_on = (rows["flags"][slots[:-1]] & TERMINATED) == 0
        if self._losses_end:
            going_on &= rewards >= 0
        discounts = self._discounts[rows["elapsed"][slots[:-1]]] * going_on
        so_far = np.cumprod(discounts, axis=0)
        returns = rewards[0] + (so_far[:-1] * rewards[1:]).sum(axis=0)
        return {
            "ids": path[0],
            "a_tm1": rows["actions"][slots[0]],
            "r_t": returns.astype(np.float32),
            "discount_t": so_far[-1].astype(np.float32),
            "weights": weights,
            "x_tm1": rows["vectors"][slots[0]],
            "x_t": rows["vectors"][slots[-1]],
            "drawn": {name: self._values(name, slots[0]) for name in self._drawn},
        }

    def _values(self, name: str, slots: Ids) -> NDArray[Any]:
        array = STEP_FIELDS[name].array
        if isinstance(array, Flag):
            return np.asarray((self._rows["flags"][slots] & array.bit) > 0)
        return np.asarray(self._rows[name][slots])

    def _path(self, ids: Ids) -> Ids:
        """Returns ids of the states 0 … n steps after ``ids``, ``[n + 1, B]``."""
        path = np.empty((self._n_step + 1, len(ids)), np.int64)
        path[0] = ids
        for step in range(self._n_step):
            path[step + 1] = self._next[path[step] % self._capacity]
        return path

    def _stacks(self, ids: Ids) -> Ids:
        """Returns ids of the frames in the states at ``ids``, oldest first, ``[B, H]``."""
        stacks = np.empty((len(ids), self._frame_stack), np.int64)
        stacks[:, -1] = ids
        for place in range(self._frame_stack - 1, 0, -1):
            stacks[:, place - 1] = self._previous[stacks[:, place] % self._capacity]
        return stacks

    def _frames(self, stacks: Ids) -> NDArray[np.uint8]:
        frames = self._rows["frames"]
        found = frames.take((stacks % self._capacity).reshape(-1), axis=0, mode="clip")
        return found.reshape(*stacks.shape, *frames.shape[1:])
