"""Under how much chance a network is measured: random actions of its own, the console's repeats."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Measure:
    """One row of a table of scores."""

    epsilon: float
    """Share of random actions."""
    sticky: float
    """``play.sticky``."""


HEADLINE = (
    Measure(0.001, 0.0),  # the policy itself; on a console without chance nearly one game, repeated
    Measure(0.05, 0.0),  # 2017, after Mnih et al. 2015
    Measure(0.001, 0.25),  # Machado et al. 2018, and ALE's v5 environments
)
"""The measures that stand for a policy together: none of them alone says what it can do."""
