"""`python -m benchmarks.lab.lost_points POLICY`: when in a rally a network loses its points.

A game such as Pong begins anew after each point. So a point lost tells by its time which ball was
missed: the first one after a serve, or a later one. Random actions hit every state alike; where
they cost most, the network plays with the least to spare.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Annotated, NamedTuple

from annotated_types import Ge

from actors.envs import make_env
from actors.loop import Step, play, seeds_of
from actors.policy import Policy
from benchmarks.lab.policy import PlayingOptions
from benchmarks.report import Report, Row, main
from common.checked import Fraction, FromOne
from common.command_line.played import playing_settings
from common.process.progress import Progress
from common.settings.config import RunConfig

_AFTER = {0: "the start", 1: "a point won", -1: "a point lost"}


@dataclass(frozen=True, kw_only=True)
class Options(PlayingOptions):
    """Count the points of whole games by the agent steps since the point before."""

    epsilon: Fraction = 0.05
    """Share of random actions."""
    sticky: Fraction = 0.0
    """Probability of a sticky action in each emulator frame."""
    width: FromOne = 30
    """Agent steps of each row; in Pong a ball takes about 30 there and back."""
    seed: Annotated[int, Ge(0)] = 1
    """Seed of the games and of the random actions."""


class Point(NamedTuple):
    """A point of a game."""

    after: int
    """Sign of the point before it in its game; 0 for the first."""
    steps: int
    """Agent steps since that."""
    won: bool


def points_of(steps: Iterable[Step]) -> Iterator[Point]:
    """Yields the points of one environment's agent steps."""
    after = since = 0
    for step in steps:
        since = 1 if step.begins else since + 1
        after = 0 if step.begins else after
        if step.r_t:
            won = step.r_t > 0
            yield Point(after, since, won)
            after, since = (1 if won else -1), 0


def rows_of(points: Sequence[Point], width: int) -> list[Row]:
    """Returns a row for each time with points, ``width`` agent steps long.

    *Lost, of open* is the share of the rallies that came so far which were lost there.
    """
    rows: list[Row] = []
    for after, known in groupby(sorted(points), key=lambda point: point.after):
        rallies = list(known)
        open_ones = len(rallies)
        for time, ended in groupby(rallies, key=lambda point: point.steps // width):
            won = [point.won for point in ended]
            rows.append(
                {
                    "after": _AFTER[after],
                    "agent steps": f"{time * width} to {(time + 1) * width - 1}",
                    "won": sum(won),
                    "lost": len(won) - sum(won),
                    "lost, of open": (len(won) - sum(won)) / open_ones,
                }
            )
            open_ones -= len(won)
    return rows


def games_of(config: RunConfig, policy: Policy, games: int, seed: int) -> Iterator[Step]:
    """Yields the agent steps of so many whole games."""
    over = 0
    with closing(make_env(config, training=False)) as env, Progress("games", games) as progress:
        for step in play([env], policy, [seed]):
            yield step
            over += step.terminated or step.truncated
            if over == games:
                return
            progress.update(over)


def measure(options: Options) -> Report:
    import torch  # only here, so that wrong flags are answered at once

    torch.set_num_threads(1)
    trained = playing_settings(options.network)
    config = replace(trained, play=replace(trained.play, sticky=options.sticky))
    policy_seed, env_seed = seeds_of(options.seed)
    policy = Policy.of_file(config, options.network, options.epsilon, policy_seed)
    points = list(points_of(games_of(config, policy, options.games, env_seed)))
    lost = sum(not point.won for point in points)
    summary = {
        "network": options.network.name,
        "games": options.games,
        "epsilon": options.epsilon,
        "sticky": options.sticky,
        "seed": options.seed,
        "won": len(points) - lost,
        "lost": lost,
    }
    return Report.of(
        f"Points of {options.games} games, {len(points) - lost} won and {lost} lost",
        rows_of(points, options.width),
        summary,
    )


if __name__ == "__main__":
    main("lab.lost_points", Options, measure)
