"""Running means over the latest updates: loss, TD errors, pixels, and the algorithm's metrics."""

import torch

from common.metrics import Value
from learner.algorithm.interface import DeviceBatch, Update

HORIZON = 500
"""Number of updates over which the means forget."""
EVERY = 10
"""Interval between measured updates; measuring each one would cost a thirtieth of an update."""
PICTURES = 16
"""Number of a minibatch's pictures that are measured, since each takes 2 µs."""

_ROUNDING = 1e-5
"""Share of the mean square below which a variance in ``float32`` is nothing but rounding."""


class RunningMeans:
    """Exponential means, kept on the device so that no update waits for its figures."""

    def __init__(self) -> None:
        self._names: tuple[str, ...] = ()
        self._sums: torch.Tensor | None = None
        """Weighted sums of the figures, and last of the weights."""
        self._updates = 0

    def add(self, batch: DeviceBatch, result: Update) -> None:
        """Takes in one update."""
        self._updates += 1
        if self._updates % EVERY != 1:
            return
        figures = {
            **result.metrics,
            "loss": result.loss,
            "td_error_squared": result.td_errors.square().mean(),
            "target": result.targets.mean(),
            "target_squared": result.targets.square().mean(),
            "pixel_deviation": _deviation(batch.s_tm1[:PICTURES, -1]),
        }
        if self._sums is not None and tuple(figures) != self._names:
            raise ValueError(
                f"an update returned {', '.join(figures)}, earlier ones {', '.join(self._names)}: "
                "return the same metrics from every update."
            )
        latest = torch.stack((*figures.values(), torch.ones_like(result.loss)))
        before = torch.zeros_like(latest) if self._sums is None else self._sums
        after = before * (1 - 1 / HORIZON) ** EVERY + latest
        self._names = tuple(figures)
        # A minibatch that made a sum non-finite would stay in the means for ever.
        self._sums = torch.where(after.isfinite().all(), after, before)

    def values(self) -> dict[str, Value]:
        """Returns the means under ``learning/``, without minibatches that would make one of them
        non-finite; none before the first update.

        The relative TD error is the mean of δ², divided by the variance of the targets in the same
        samples: the share of that variance that the values leave unexplained. A network that
        answers the same to all that it sees has 1 or more. It is unknown if targets do not vary.
        """
        *sums, weight = [0.0] if self._sums is None else self._sums.tolist()
        if not weight:
            return {}
        means = {name: each / weight for name, each in zip(self._names, sums, strict=True)}
        target, square = means.pop("target"), means.pop("target_squared")
        variance = square - target * target
        varies = variance > _ROUNDING * square
        error = means["td_error_squared"] / variance if varies else None
        return {
            "learning/relative_td_error": error,
            **{f"learning/{name}": mean for name, mean in means.items()},
        }


def _deviation(pictures: torch.Tensor) -> torch.Tensor:
    """Returns the mean of the standard deviations of ``pictures uint8 [N, height, width]``, sooner
    than PyTorch's ``std``."""
    pixels = pictures.flatten(1).float()
    pixels -= pixels.mean(dim=1, keepdim=True)
    return pixels.square().mean(dim=1).sqrt().mean()
