"""The states on which max-Q is measured: some held out after the warm-up, and some recent ones.

The mean over the held-out states can be compared over a whole run. The recent states show whether
the robot still sees, because held-out states keep their values when the camera fails.
"""

from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load, save

from common.atomic_file import write_atomically
from common.errors import InputError
from common.metrics import Value
from common.protocol.step_fields import FRAME_SHAPE
from common.regular_file import read_file
from common.settings.config import RunConfig
from learner.algorithm.interface import Algorithm
from learner.telemetry.snapshot import Histogram
from replay.interface import Replay

RECENT = 64
"""Number of recent states on which max-Q is measured."""
RECENT_STEPS = 2_000
"""Number of newest frames in the ring, from which the recent states are drawn."""
LEAST_RECENT = 16
_BINS = 30


class HeldOut:
    """Measures max-Q on a fixed set of states, kept in the run's folder, and on up to `RECENT` of
    the newest steps. The screen was found in all their frames."""

    def __init__(self, path: Path, config: RunConfig, algorithm: Algorithm, replay: Replay) -> None:
        """Loads the set at ``path`` if there is one.

        Raises:
            InputError: the file is damaged.
        """
        self._path = path
        self._count = config.protocol.held_out_states
        self._algorithm = algorithm
        self._replay = replay
        self._states: tuple[torch.Tensor, torch.Tensor] | None = None
        self.mean: float | None = None
        """Mean of max-Q over the held-out states, as last measured."""
        self.histogram: Histogram | None = None
        """Max-Q over the held-out states, as last measured."""
        self._std: float | None = None
        self._recent_std: float | None = None
        if path.exists():
            try:
                self._states = _states_in(read_file(path), config)
            except (SafetensorError, OSError, ValueError, TypeError, KeyError) as error:
                raise InputError(
                    f"{path} is damaged ({error}): delete it, and max-Q is measured on other "
                    "states from then on; or restore the file."
                ) from None

    def draw(self) -> None:
        """Draws the fixed set from the replay, and writes it, unless there is one. A replay whose
        frames are all blind has no state for it."""
        if self._states is None and (states := self._drawn(self._count)) is not None:
            write_atomically(self._path, save({"frames": states[0], "vectors": states[1]}))
            self._states = states

    def measure(self) -> None:
        """Measures max-Q with the present weights."""
        if self._states is not None:
            values = self._algorithm.max_q(*self._states)
            self.mean, self._std = float(values.mean()), float(values.std(unbiased=False))
            if values.isfinite().all():
                self.histogram = _spread(values)
        self._recent_std = None
        recent = self._drawn(RECENT, RECENT_STEPS)
        if recent is not None and len(recent[0]) >= LEAST_RECENT:
            self._recent_std = float(self._algorithm.max_q(*recent).std(unbiased=False))

    def values(self) -> dict[str, Value]:
        """Returns the figures as last measured; the one of the recent states is unknown if there
        were too few."""
        return {
            "learning/mean_max_q": self.mean,
            "learning/held_out_std": self._std,
            "learning/recent_max_q_std": self._recent_std,
        }

    def _drawn(
        self, count: int, newest: int | None = None
    ) -> tuple[torch.Tensor, torch.Tensor] | None:
        """Returns frames and vectors of up to ``count`` states; None if there are none."""
        frames, vectors = self._replay.held_out(count, newest)
        return (torch.tensor(frames), torch.tensor(vectors)) if len(frames) else None


def _states_in(content: bytes, config: RunConfig) -> tuple[torch.Tensor, torch.Tensor]:
    """Returns frames and vectors; raises the errors of `load`, or ValueError if they do not fit."""
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
    """Returns the histogram of finite ``values``, ``float32 [states]``.

    The values of a collapsed network are all equal, or differ only in their last bits.
    """
    # In float64, because NumPy refuses bins narrower than the spacing of its numbers.
    exact = values.double().numpy()
    least, most = float(exact.min()), float(exact.max())
    if least == most:
        width = max(abs(least), 0.5)
        least, most = least - width, most + width
    counts, edges = np.histogram(exact, _BINS, (least, most))
    return Histogram(counts.tolist(), edges.tolist())
