"""Running means over the latest updates: loss, TD error, rewards, pixels."""

import torch

from learner.algorithm.interface import DeviceBatch, Update

HORIZON = 500
"""Updates over which the means forget."""
EVERY = 10
"""Updates of which one is measured; measuring each would cost a thirtieth of it."""


class RunningMeans:
    """Exponential means, kept on the device so that no update waits for its own figures."""

    def __init__(self) -> None:
        self._sums: torch.Tensor | None = None
        self._weight = 0.0
        self._updates = 0

    def add(self, batch: DeviceBatch, result: Update) -> None:
        self._updates += 1
        if self._updates % EVERY != 1:
            return
        newest = batch.s_tm1[:, -1].float()
        figures = torch.stack(
            (
                result.loss,
                result.metrics["td_error_squared"],
                batch.r_t.mean(),
                batch.r_t.square().mean(),
                newest.std(dim=(1, 2)).mean(),
            )
        )
        keep = (1 - 1 / HORIZON) ** EVERY
        self._sums = figures if self._sums is None else self._sums * keep + figures
        self._weight = self._weight * keep + 1

    def read(self) -> tuple[float, float, float, float] | None:
        """Loss, squared TD error, variance of rewards, deviation of pixels; None before any."""
        if self._sums is None:
            return None
        loss, error, reward, square, pixels = (self._sums / self._weight).tolist()
        return loss, error, max(square - reward * reward, 0.0), pixels
