"""The states by which max-Q is watched: some held out after the warm-up, and some of late.

The mean over the held-out states can be compared over a whole run. What the network says of the
newest steps shows whether it still sees: held-out states keep their values when the camera fails.
"""

from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load, save

from common.errors import InputError
from common.protocol.step_fields import FRAME_SHAPE
from common.regular_file import read_file
from common.run.config import RunConfig
from common.run.folder import write_atomically
from learner.algorithm.interface import Algorithm
from learner.telemetry.snapshot import Histogram
from replay.interface import Replay

RECENT = 64
"""Recent states on which max-Q is measured."""
RECENT_STEPS = 2_000
"""Newest frames in the ring, of which those states are."""
LEAST_RECENT = 16
_BINS = 30


class HeldOut:
    """A fixed set of states, kept in the run's folder, and as many as `RECENT` of the newest steps;
    all of their frames showed the screen."""

    def __init__(self, path: Path, config: RunConfig) -> None:
        """Take up the set at ``path`` if there is one.

        Raises:
            InputError: the file is damaged.
        """
        self._path = path
        self._states: tuple[torch.Tensor, torch.Tensor] | None = None
        self.max_q: tuple[float, float] | None = None
        """Mean and standard deviation of max-Q, as last measured."""
        self.histogram: Histogram | None = None
        """Max-Q over the held-out states, as last measured."""
        self.recent_std: float | None = None
        """Standard deviation of max-Q over the recent states; None if there were too few."""
        if path.exists():
            try:
                self._states = _states_in(read_file(path), config)
            except (SafetensorError, OSError, ValueError, TypeError, KeyError) as error:
                raise InputError(
                    f"{path} is damaged ({error}): remove the run, or put the file back."
                ) from None

    def draw(self, replay: Replay, count: int) -> None:
        """Choose up to ``count`` states of the replay; with none there, stay without."""
        frames, vectors = replay.held_out(count)
        if not len(frames):
            return
        self._states = torch.from_numpy(frames.copy()), torch.from_numpy(vectors.copy())
        content = save({"frames": self._states[0], "vectors": self._states[1]})
        write_atomically(self._path, content)

    def measure(self, algorithm: Algorithm, replay: Replay) -> None:
        """Measure ``max_q`` and ``recent_std`` by the present weights."""
        if self._states is not None:
            values = algorithm.max_q(*self._states)
            self.max_q = float(values.mean()), float(values.std(unbiased=False))
            if values.isfinite().all():
                self.histogram = _spread(values)
        self.recent_std = None
        frames, vectors = replay.held_out(RECENT, RECENT_STEPS)
        if len(frames) >= LEAST_RECENT:
            recent = torch.from_numpy(frames.copy()), torch.from_numpy(vectors.copy())
            values = algorithm.max_q(*recent)
            self.recent_std = float(values.std(unbiased=False))


def _states_in(content: bytes, config: RunConfig) -> tuple[torch.Tensor, torch.Tensor]:
    """Returns frames and vectors; raises what `load` does, or ValueError if there are none."""
    found = load(content)
    frames, vectors = found["frames"], found["vectors"]
    count = len(frames)
    for each, dtype, shape in (
        (frames, torch.uint8, (count, config.play.frame_stack, *FRAME_SHAPE)),
        (vectors, torch.float32, (count, config.vector_width)),
    ):
        if not count or (each.dtype, each.shape) != (dtype, shape):
            raise ValueError("its states are not this run's")
    return frames, vectors


def _spread(values: torch.Tensor) -> Histogram:
    """Returns how finite ``values``, ``float32 [states]``, are spread.

    Those of a network that has collapsed differ by nothing, or by their last bits alone.
    """
    # NumPy refuses bins narrower than what numbers of their type are apart.
    exact = values.double().numpy()
    least, most = float(exact.min()), float(exact.max())
    if least == most:
        width = max(abs(least), 0.5)
        least, most = least - width, most + width
    counts, edges = np.histogram(exact, _BINS, (least, most))
    return Histogram(counts.tolist(), edges.tolist())
