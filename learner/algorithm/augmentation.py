"""Augmentation of drawn states: the random shift of DrQ (Yarats, Kostrikov and Fergus 2021).

A picture moved by a few pixels means the same to a player. A network that sees shifted pictures
does not learn single pixels by heart. All frames of a state move together, or the ball would jump.
The two states of a transition move independently, as in DrQ.
"""

import numpy as np
import torch
from torch import Tensor

from learner.algorithm.interface import DeviceBatch


class RandomShift:
    """Shifts states by up to ``most`` pixels, up or down and left or right; 0 for not at all."""

    def __init__(self, most: int, seed: int) -> None:
        self._most = most
        self._seed = seed
        self.reseed(0)

    def reseed(self, updates: int) -> None:
        """Seeds the generator for a process that continues after ``updates``, so that it does not
        repeat the shifts of the run's start."""
        (seed,) = np.random.SeedSequence([self._seed, updates]).generate_state(1, np.uint64)
        self._generator = torch.Generator().manual_seed(int(seed))

    def __call__(self, batch: DeviceBatch) -> DeviceBatch:
        """Returns ``batch`` with shifted states of the same shape and type."""
        if not self._most:
            return batch
        return batch._replace(s_tm1=self.shift(batch.s_tm1), s_t=self.shift(batch.s_t))

    def shift(self, frames: Tensor) -> Tensor:
        """Returns shifted ``frames``, ``uint8 [batch, frame_stack, height, width]``.

        Each state has its own shift; pixels that move in repeat the edge.
        """
        batch, _, height, width = frames.shape
        down, across = torch.randint(2 * self._most + 1, (2, batch), generator=self._generator)
        # All shifts of all states, as views; only the drawn ones are copied.
        windows = self._padded(frames).unfold(2, height, 1).unfold(3, width, 1)
        which = torch.arange(batch, device=frames.device)
        return windows[which, :, down.to(frames.device), across.to(frames.device)]

    def _padded(self, frames: Tensor) -> Tensor:
        """Returns ``frames`` padded by their edges; PyTorch can do this for floats only."""
        most = self._most
        batch, frame_stack, height, width = frames.shape
        padded = frames.new_empty(batch, frame_stack, height + 2 * most, width + 2 * most)
        bottom, right = most + height, most + width
        padded[:, :, most:bottom, most:right] = frames
        padded[:, :, :most, most:right] = frames[:, :, :1]
        padded[:, :, bottom:, most:right] = frames[:, :, -1:]
        padded[..., :most] = padded[..., most : most + 1]
        padded[..., right:] = padded[..., right - 1 : right]
        return padded
