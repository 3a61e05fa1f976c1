"""Statistics of scores: mean, deviation, and the interquartile mean with its uncertainty.

The interquartile mean (IQM) is the mean of the middle half. Single games move it less than the
mean, and it wastes less data than the median (Agarwal et al. 2021, "Deep reinforcement learning at
the edge of the statistical precipice"). Its interval is their stratified bootstrap: games are
resampled with replacement within each stratum. An evaluation is one stratum, because one network
plays one game under one setting. If games repeat each other instead of being independent, the
interval is too narrow.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

RESAMPLES = 10_000
_MAX_DRAWN = 2_000_000
"""Maximum number of scores that are resampled at a time, 16 MB; a short game is played often."""


@dataclass(frozen=True)
class Scores:
    """Statistics of the scores of some games."""

    games: int
    mean: float
    deviation: float
    """Standard deviation of the sample (n - 1); 0 for one game."""
    median: float
    least: float
    most: float
    iqm: float
    iqm_low: float
    """Lower end of the 95 % bootstrap interval of the IQM."""
    iqm_high: float

    @classmethod
    def of(cls, scores: Sequence[float], seed: int = 1) -> "Scores":
        """Returns the statistics of at least one game; ``seed`` is that of the bootstrap."""
        found = np.asarray(scores, np.float64)
        rng = np.random.default_rng(seed)
        at_once = max(_MAX_DRAWN // len(found), 1)
        means = np.concatenate(
            [
                interquartile_mean(rng.choice(found, (min(at_once, RESAMPLES - begin), len(found))))
                for begin in range(0, RESAMPLES, at_once)
            ]
        )
        low, high = np.percentile(means, (2.5, 97.5))
        return cls(
            games=len(found),
            mean=float(found.mean()),
            deviation=float(found.std(ddof=1)) if len(found) > 1 else 0.0,
            median=float(np.median(found)),
            least=float(found.min()),
            most=float(found.max()),
            iqm=float(interquartile_mean(found[None])[0]),
            iqm_low=float(low),
            iqm_high=float(high),
        )


def interquartile_mean(scores: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the mean of each row of ``[R, N]``, without the lowest and the highest ⌊N / 4⌋."""
    out = scores.shape[1] // 4
    middle = np.sort(scores, axis=1)[:, out : scores.shape[1] - out]
    return np.asarray(middle.mean(axis=1))
