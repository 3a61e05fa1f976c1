"""`python -m benchmarks.lab.adaptation POLICY --to="--robot robotroller"`: learning another world.

It measures how soon a policy plays as well in another world as in its own. The network plays in its
own world and, without further training, in the other one. There it is then trained for a fixed
number of agent steps, and plays once more. The same command resumes an interrupted training.
"""

import shlex
from dataclasses import dataclass

from benchmarks.lab.policy import (
    PlayingOptions,
    TrainingOptions,
    evaluate,
    held_from,
    scores_of,
    train,
)
from benchmarks.report import Report, Table, main
from common.checked import FromOne
from common.command_line.run_options import parse_run
from common.registry import ENVIRONMENTS
from common.run.epochs import EpochTable
from common.run.folder import RunFolder
from common.run.origin import trained_settings
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from common.settings.stored_config import flag_of, flat
from learner.options import LearnerOptions

ADAPTING = {
    "learning.learning-rate": "2e-4",
    "learning.final-learning-rate": "2e-5",
    "replay.learning-starts": "1000",
    "replay.capacity": "100000",
    "exploration.start": "0.05",
    "exploration.end": "0.02",
    "exploration.steps": "5000",
}
"""Settings of the training. To keep what was learned before, nearly all actions are the
policy's."""
_AS_FRUGAL = (
    "learning.batch_size",
    "learning.train_period",
    "learning.target_update_period",
    "learning.publish_period",
)
"""Settings that are those of the preset frugal: steps of a body are expensive and therefore few, so
there is an update at each. Of 16 samples it brings twice as much as one of 64 at every second
(LOG.md)."""
_WORLD = ("play.", "camera.", "randomise.")
_EPOCHS = 10
_NEAR = 2.0
"""Points that a policy may stay below the score in its own world and still count as adapted."""


@dataclass(frozen=True)
class Options(TrainingOptions, PlayingOptions):
    """Train a policy for a while in a world other than its own, and play before and after."""

    to: str
    """Settings of the other world, as in --to="--camera.noise 8 --play.sticky 0.25"."""
    steps: FromOne = 20_000
    """Length of the training, in agent steps."""
    run: str = "adaptation"
    """Name of the training's run."""


def measure(options: Options) -> Report:
    trained = trained_settings(options.network)
    to = shlex.split(options.to)
    folder = RunFolder(options.runs, options.run)
    fixed = ["--evaluators", "0", "--seed", f"{options.seed}"]
    initial = ["--initial", str(options.network)]  # which gives the run its layers
    flags = [*training_flags(trained, options.steps), *fixed, *to, *shlex.split(options.learner)]
    # Settings with which nothing could train are refused before anything is played.
    parse_run(LearnerOptions, "learner", [*flags, *initial], lambda _: None)
    games = {
        "own": evaluate(options.network, options.games, options.epsilon),
        "before": evaluate(options.network, options.games, options.epsilon, to),
    }
    train(folder, options.steps, [*flags, *initial])
    # The world again: an evaluation draws only from the ranges that its own flags name.
    games["after"] = evaluate(folder.checkpoint, options.games, options.epsilon, to)
    curve = scores_of(EpochTable(folder.epochs).rows())
    least = games["own"]["mean"] - _NEAR
    # An epoch has few games, so those of the last weights must confirm them.
    reached = held_from(curve, least) if games["after"]["mean"] >= least else None
    rows = [
        {
            "world": title,
            "games": options.games,
            "mean": games[name]["mean"],
            "deviation": games[name]["deviation"],
            "IQM": games[name]["iqm"],
        }
        for name, title in (
            ("own", "its own"),
            ("before", "the other, not trained anew"),
            ("after", f"the other, after {options.steps:,} agent steps"),
        )
    ]
    points = [
        {"steps": row.total_train_steps, "minutes": row.total_time / 60, "score": mean}
        for row, mean in curve
    ]
    note = (
        "it did not come to stay within two points of its own world"
        if reached is None
        else f"from {reached.total_train_steps:,} training steps and "
        f"{reached.total_time / 60:.0f} minutes on it was within two points of its own world"
    )
    title = f"{options.network.stem} in the world of {options.to}, ε = {options.epsilon:g}"
    tables = [Table(title, rows)] + ([Table("training games", points)] if points else [])
    content = {
        "title": title,
        "flags": shlex.join(flags),
        **games,
        "curve": points,
        "steps_to_own": None if reached is None else reached.total_train_steps,
    }
    return Report(tables, content, (note,))


def training_flags(trained: RunConfig, steps: int) -> list[str]:
    """Returns the flags of a run in the world of ``trained``, with the settings of `ADAPTING`."""
    preset = PRESETS[ENVIRONMENTS.find(trained.env).preset]
    schedule = {
        "learning.annealing-steps": f"{steps}",
        "protocol.epoch-steps": f"{max(steps // _EPOCHS, 1)}",
    }
    settings = {"preset": preset.preset, "env": trained.env, "game": trained.game}
    usual = flat(preset)
    world = {
        name: value
        for name, value in flat(trained).items()
        if value != usual[name] and name.startswith(_WORLD)
    }
    frugal = flat(PRESETS["frugal"])
    updates = {name: frugal[name] for name in _AS_FRUGAL}
    given = settings | updates | ADAPTING | schedule | world
    return [word for name, value in given.items() for word in flag_of(name, value)]


if __name__ == "__main__":
    main("lab.adaptation", Options, measure)
