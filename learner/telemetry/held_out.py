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
from common.regular_file import read_file
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

    def __init__(self, path: Path) -> None:
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
                found = load(read_file(path))
                self._states = found["frames"], found["vectors"]
            except (SafetensorError, OSError, KeyError) as error:
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
                counts, edges = np.histogram(values.numpy(), _BINS)
                self.histogram = Histogram(counts.tolist(), edges.tolist())
        self.recent_std = None
        frames, vectors = replay.held_out(RECENT, RECENT_STEPS)
        if len(frames) >= LEAST_RECENT:
            recent = torch.from_numpy(frames.copy()), torch.from_numpy(vectors.copy())
            values = algorithm.max_q(*recent)
            self.recent_std = float(values.std(unbiased=False))
