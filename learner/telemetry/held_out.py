"""The held-out states: drawn once after the warm-up, to watch the mean max-Q over a whole run."""

from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save

from common.errors import InputError
from common.run.folder import write_atomically
from learner.algorithm.interface import Algorithm
from replay.interface import Replay


class HeldOut:
    """A fixed set of states all of whose frames showed the screen, kept in the run's folder."""

    def __init__(self, path: Path) -> None:
        """Take up the set at ``path`` if there is one.

        Raises:
            InputError: the file is damaged.
        """
        self._path = path
        self._states: tuple[torch.Tensor, torch.Tensor] | None = None
        self.max_q: tuple[float, float] | None = None
        """Mean and standard deviation of max-Q, as last measured."""
        if path.exists():
            try:
                found = load_file(path)
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

    def measure(self, algorithm: Algorithm) -> None:
        """Measure ``max_q`` by the present weights."""
        if self._states is not None:
            values = algorithm.max_q(*self._states)
            self.max_q = float(values.mean()), float(values.std(unbiased=False))
