"""What an evaluation plays: how many games, under how much chance."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from annotated_types import Le

from common.checked import Count, Fraction, FromOne
from common.command_line.parser import check_bounds
from common.errors import InputError
from common.process.cores import usable_cores
from common.registry import ENVIRONMENTS
from common.settings.config import RunConfig
from learner.results_file import check_results_file


@dataclass(frozen=True)
class Measure:
    """The amount of chance in one measurement: one row of a table of scores."""

    epsilon: float
    """Share of random actions."""
    sticky: float
    """``play.sticky``, the probability that the console repeats an action."""


EPSILON = 0.001
"""Share of random actions in an evaluation for which none is given."""

GAMES = 30
"""Number of games of an evaluation for which none is given."""

MOST_GAMES = 1_000_000

HEADLINE = (
    Measure(EPSILON, 0.0),  # the policy itself: nearly one game, repeated
    Measure(0.05, 0.0),  # 2017, after Mnih et al. 2015
    Measure(EPSILON, 0.25),  # Machado et al. 2018, and ALE's v5 environments
)
"""The measurements that describe a policy together; none of them alone says what it can do."""


@dataclass(frozen=True)
class EvaluationOptions:
    """How many games are played, under how much chance, and where the results go."""

    headline: bool = False
    """Three evaluations in one table and one file: with 0.001 random actions, with 0.05 as in 2017,
    and with 0.001 under sticky actions (--play.sticky 0.25), which only Atari games have."""
    games: Annotated[FromOne, Le(MOST_GAMES)] = GAMES
    """Number of games, over all processes; with --headline, of each of its three evaluations."""
    test_steps: Count = 0
    """Minimum number of agent steps, over all processes; the tests of 2017 played 125,000."""
    epsilon: Fraction | None = None
    """Share of random actions, 0 to 1, by default 0.001; the tests of 2017 had 0.05."""
    processes: Count = 0
    """Number of games played at the same time; 0 for as many as there are cores. Which games are
    played depends on it, as each process has a seed of its own."""
    json: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """File for the results, as JSON; earlier results in it are replaced."""

    def check(self) -> None:
        """Refuses options that cannot be followed.

        Raises:
            InputError: an option is out of bounds or has no effect, or the file cannot be written.
        """
        check_bounds(self)
        if self.headline and self.epsilon is not None:
            raise InputError("--headline has its own shares of random actions: omit --epsilon.")
        if self.json is not None:
            check_results_file(self.json)  # before the games, not after them

    @property
    def at_once(self) -> int:
        """Number of games that are played at the same time."""
        return min(self.processes or usable_cores(), self.games)

    def measures(self, config: RunConfig, trained: RunConfig | None) -> Sequence[Measure]:
        """Returns the measurements to make.

        Args:
            trained: settings that the network was trained under.

        Raises:
            InputError: ``config`` has or draws sticky actions of its own, beside a headline's.
        """
        if not self.headline:
            epsilon = EPSILON if self.epsilon is None else self.epsilon
            return (Measure(epsilon, config.play.sticky),)
        if config.play.sticky != (trained or RunConfig()).play.sticky:
            raise InputError("--headline has its own sticky actions: omit --play.sticky.")
        if config.randomise.sticky:  # as by --randomise.all
            raise InputError("--headline has its own sticky actions: give --randomise.sticky 0.")
        # Without a console, the same games would be played again and called sticky.
        has_console = ENVIRONMENTS.find(config.env).atari
        return [each for each in HEADLINE if has_console or not each.sticky]
