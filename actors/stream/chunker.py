"""Cuts one environment's steps into chunks."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actors.loop import Step
from common.protocol.chunk import Chunk, Game
from common.protocol.step_fields import STEP_FIELDS

STEP_VALUES: dict[str, Callable[[Step], Any]] = {
    "frames": lambda step: step.s_tm1,
    "actions": lambda step: step.a_tm1,
    "rewards": lambda step: step.r_t,
    "terminated": lambda step: step.terminated,
    "truncated": lambda step: step.truncated,
    "elapsed": lambda step: step.info.elapsed,
    "valid": lambda step: step.valid,
    "follows": lambda step: step.info.frame_follows,
    "matched": lambda step: step.info.keys_match,
    "vectors": lambda step: step.x_tm1,
}
"""The value of each field in a step; of the state's frames a chunk keeps only the newest."""


class Chunker:
    """Gathers the steps of one stream and returns a chunk after every ``length`` steps.

    A chunk's frames are the newest of each state. Its ``context`` holds the older frames of its
    first state, as far as they belong to the same episode.
    """

    def __init__(self, run_id: str, actor: str, incarnation: int, stream: int, length: int) -> None:
        self._identity = (run_id, actor, incarnation, stream)
        self._length = length
        self._sequence = 0
        self._age = 0  # steps of the present episode before the next step
        self._steps: list[Step] = []
        self._context: NDArray[np.uint8]

    def add(self, step: Step) -> Chunk | None:
        """Returns the chunk that ``step`` completes, if any."""
        if step.begins:
            self._age = 0
        if not self._steps:
            self._context = step.s_tm1[-1 - self._age : -1].copy()
        self._age += 1
        # The loop overwrites its states in place, and an environment may do so with its
        # observations, so copy what the chunk needs.
        self._steps.append(
            step._replace(
                s_tm1=step.s_tm1[-1].copy(),
                s_t=step.s_t[-1].copy(),
                x_tm1=step.x_tm1.copy(),
                x_t=step.x_t.copy(),
            )
        )
        return self.cut() if len(self._steps) == self._length else None

    def cut(self) -> Chunk | None:
        """Returns the steps gathered so far as a chunk; None if there are none."""
        if not self._steps:
            return None
        steps, self._steps = self._steps, []
        run_id, actor, incarnation, stream = self._identity
        cut = [step for step in steps if step.truncated]
        frame, width = steps[0].s_tm1.shape, len(steps[0].x_tm1)
        chunk = Chunk(
            run_id=run_id,
            actor=actor,
            incarnation=incarnation,
            stream=stream,
            sequence=self._sequence,
            # The oldest version, so that staleness is never understated.
            weights_version=min(step.weights_version for step in steps),
            epsilon=steps[-1].epsilon,
            context=self._context,
            final_frames=np.array([step.s_t for step in cut], np.uint8).reshape(len(cut), *frame),
            final_vectors=np.array([step.x_t for step in cut], np.float32).reshape(len(cut), width),
            games=tuple(
                Game(step.info.game_score, step.info.game_steps)
                for step in steps
                if step.info.game_over
            ),
            **{
                name: np.array([value(step) for step in steps], STEP_FIELDS[name].dtype)
                for name, value in STEP_VALUES.items()
            },
        )
        self._sequence += 1
        return chunk
