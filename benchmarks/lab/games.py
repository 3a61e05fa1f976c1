"""`python -m benchmarks.lab.games --json FILE`: what a body costs, game by game.

For each game, a robot and its twin, which plays by the emulator alone, are trained from scratch for
the same number of agent steps, with the same settings for all games. Afterwards the last weights
play the three evaluations of --headline. The share is the robot's rise over random play divided by
its twin's. The same command continues with what was interrupted or is missing.

`python -m benchmarks.figures.plot --figure games FILE` draws the curves of training.
"""

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, NamedTuple

from annotated_types import MinLen

from benchmarks.lab.policy import TrainingOptions, headline, scores_of, train
from benchmarks.report import Report, main, measure_missing, resumed, scored
from common.checked import FromOne
from common.games import check_game
from common.run.epochs import EpochTable
from common.run.folder import RunFolder
from common.settings.config import PresetName


class Anchors(NamedTuple):
    """Mean scores of a game in Mnih et al. 2015, extended data table 2."""

    random: float
    human: float


ANCHORS = {
    "assault": Anchors(222.4, 1_496.0),
    "asterix": Anchors(210.0, 8_503.0),
    "breakout": Anchors(1.7, 31.8),
    "kangaroo": Anchors(52.0, 3_035.0),
    "ms_pacman": Anchors(307.3, 15_693.0),
    "pong": Anchors(-20.7, 9.3),
    "seaquest": Anchors(68.4, 20_182.0),
}
"""The six games of Physical Atari (2026), and Breakout. Random play scores differently here: it
begins with up to 30 random actions, and plays each game to its end."""
BODIES = {"ale": "emulator alone", "robot": "robot"}
"""Environments in the order of training, each with its name for people."""
_SAME = ("preset", "learner", "steps", "seed")
"""Options that all results of a file share."""
_TOLD = ("agent_steps", "wall_seconds", "random_reward", "git_commit", "git_dirty", "machine")
"""Figures that are taken from a run's ``summary.json``."""
_OF_HEADLINE = [
    "epsilon",
    "sticky",
    "mean",
    "deviation",
    "iqm",
    "distinct_games",
    "steps",
    "scores",
]
"""Figures that are taken from each evaluation."""


@dataclass(frozen=True)
class Options(TrainingOptions):
    """Train a robot and its twin without a body on each game, equally long, and play both."""

    game: Annotated[tuple[str, ...], MinLen(1)] = tuple(ANCHORS)
    """Games; any that ale-py bundles."""
    preset: PresetName = "robot"
    """Preset of all runs, twins included."""
    steps: FromOne = 300_000
    """Length of each run, in agent steps, including the warm-up."""

    def check(self) -> None:
        super().check()
        for game in self.game:
            check_game(game)

    def flags(self, game: str, env: str) -> list[str]:
        """Returns the flags of a run's learner, without its folder and its steps."""
        run = ["--preset", self.preset, "--env", env, "--game", game, "--seed", f"{self.seed}"]
        return [*run, "--evaluators", "0", *self.learner_flags]

    def folder(self, game: str, env: str) -> RunFolder:
        return RunFolder(self.runs, f"games-{game}-{env}-{self.seed}".replace("_", "-"))


def measure(options: Options) -> Report:
    about = {name: getattr(options, name) for name in _SAME}
    found = resumed(options.json, about, "games of this budget, seed and these flags")
    found.pop("rows", None)  # the old rows have fewer games
    title = f"after {options.steps:,} agent steps, preset {options.preset} {options.learner}"
    asked = [{"game": game, "env": env} for game in options.game for env in BODIES]
    runs = measure_missing(options.json, found, "runs", asked, partial(_train, options))
    return Report.of(title.strip(), _rows(runs), found)


def _train(options: Options, game: str, env: str) -> dict[str, Any]:
    folder = options.folder(game, env)
    summary = train(folder, options.steps, options.flags(game, env))
    scores = scores_of(EpochTable(folder.epochs).rows())
    return {
        **{name: summary[name] for name in _TOLD},
        "curve": [(row.total_train_steps, mean) for row, mean in scores],
        "headline": [
            {name: row[name] for name in _OF_HEADLINE} for row in headline(folder.checkpoint)
        ],
    }


def share_of_rise(random: float | None, twin: float, robot: float) -> float | None:
    """Returns a robot's rise over random play as a share of its twin's; None if
    the twin has none."""
    return None if random is None or twin <= random else (robot - random) / (twin - random)


def _rows(runs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Returns a row for each game and each evaluation that both robot and twin have."""
    by_game: dict[str, dict[str, Any]] = {}
    for run in runs:
        by_game.setdefault(run["game"], {})[run["env"]] = run
    rows = []
    for game, both in by_game.items():
        twin, robot = (both.get(env) for env in BODIES)
        if twin is None or robot is None:
            continue
        anchors = ANCHORS.get(game)
        random = twin["random_reward"]
        for of_twin, of_robot in zip(twin["headline"], robot["headline"], strict=True):
            share = share_of_rise(random, of_twin["mean"], of_robot["mean"])
            rows.append(
                {
                    "game": game,
                    "ε": of_twin["epsilon"],
                    "sticky": of_twin["sticky"],
                    "random": random,
                    "human": anchors and anchors.human,
                    BODIES["ale"]: scored(of_twin),
                    BODIES["robot"]: scored(of_robot),
                    "share of the rise": None if share is None else f"{share:.0%}",
                }
            )
    return rows


if __name__ == "__main__":
    main("lab.games", Options, measure)
