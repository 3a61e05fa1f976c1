"""`python -m benchmarks.lab.adaptation POLICY --to="--robot robotroller"`: learning a new world.

It measures how soon a policy plays as well in another world as in its own. The network plays in its
own world and, without further training, in the other one. There it is then trained for a fixed
number of agent steps, and plays whole games again and again meanwhile. The same command resumes an
interrupted training.
"""

import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.lab.policy import PlayingOptions, TrainingOptions, evaluate, noted, train
from benchmarks.quoted_flags import quoted_flags
from benchmarks.report import Report, Table, main
from common.atomic_file import write_json
from common.checked import FromOne
from common.command_line.run_options import parse_run
from common.errors import InputError
from common.registry import ENVIRONMENTS
from common.run.folder import RunFolder
from common.run.origin import identity_of, trained_settings
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from common.settings.stored_config import flag_of, flat
from learner.options import LearnerOptions

ADAPTING = {
    "learning.learning_rate": "2e-4",
    "learning.final_learning_rate": "2e-5",
    "replay.learning_starts": "1000",
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
"""Settings taken from the preset `frugal`. A robot's steps are expensive, so each one gets an
update. One of 16 samples brings twice as much as one of 64 at every second step (LOG.md)."""
_WORLD = ("play.", "camera.", "randomise.")
_EPOCHS = 10
_NEAR = 2.0
"""Points that a policy may stay below the score in its own world and still count as adapted."""


@dataclass(frozen=True)
class Options(TrainingOptions, PlayingOptions):
    """Train a policy for a while in a world other than its own, and play before, meanwhile and
    after."""

    to: str
    """Settings of the other world, as in --to="--camera.noise 8 --play.sticky 0.25"."""
    steps: FromOne = 20_000
    """Length of the training, in agent steps."""
    tests: FromOne = 4
    """Number of times that the network plays in the other world while it is trained, evenly spread;
    the last is after it."""
    run: str = "adaptation"
    """Name of the training's run."""

    def check(self) -> None:
        super().check()
        if self.tests > self.steps:
            raise InputError(f"--tests {self.tests} is more than --steps: choose fewer tests.")
        quoted_flags(self.to, "--to", ("--seed",))


def measure(options: Options) -> Report:
    trained = trained_settings(options.network)
    to = quoted_flags(options.to, "--to")
    folder = RunFolder(options.runs, options.run)
    fixed = ["--evaluators", "0", "--seed", f"{options.seed}"]
    flags = [
        *training_flags(trained, options.steps),
        *fixed,
        *to,
        *options.learner_flags,
    ]
    # Settings with which nothing could train are refused before anything is played.
    initial = ["--initial", str(options.network)]
    first = ["--steps", f"{options.steps // options.tests}"]
    parse_run(LearnerOptions, "learner", [*flags, *initial, *first], lambda _: None)
    asked = {"flags": flags, "initial": identity_of(options.network)}
    tests = range(1, options.tests + 1)
    for test in tests:
        noted(_kept(options, folder, test).with_suffix(".json"), asked, "adaptation")
    # The other world first: one in which the network cannot play is refused at once.
    before = evaluate(options.network, options.games, options.epsilon, to)
    own = evaluate(options.network, options.games, options.epsilon)
    curve = [before | {"trained_steps": 0, "minutes": 0.0}]
    for test in tests:
        # The world again: an evaluation draws only from the ranges that its own flags name.
        curve.append(_after(options, folder, test, asked, to))
    reached = held_from(curve, own["mean"] - _NEAR)
    shown = ("mean", "deviation", "iqm")
    rows = [{"world": "its own", "minutes": None} | {name: own[name] for name in shown}]
    rows += [
        {"world": f"the other, {each['trained_steps']:,} agent steps", "minutes": each["minutes"]}
        | {name: each[name] for name in shown}
        for each in curve
    ]
    note = (
        f"after all of them it was not within {_NEAR:g} points of its own world"
        if reached is None
        else f"from {reached['trained_steps']:,} agent steps and {reached['minutes']:.1f} "
        f"minutes of training on it was within {_NEAR:g} points of its own world"
    )
    title = (
        f"{options.network.stem} in the world of {options.to}, ε = {options.epsilon:g}, "
        f"{options.games} games each"
    )
    content = {
        "flags": shlex.join(flags),
        "own": own,
        "curve": curve,
        "steps_to_own": None if reached is None else reached["trained_steps"],
    }
    return Report([Table(title, rows)], {"title": title, **content}, (note,))


def _after(
    options: Options, folder: RunFolder, test: int, asked: dict[str, Any], to: list[str]
) -> dict[str, Any]:
    """Returns the evaluation after so many of the tests' shares of the training, which goes on
    until then. Raises InputError if the folder holds those of another training."""
    kept = _kept(options, folder, test)
    note = kept.with_suffix(".json")
    known = noted(note, asked, "adaptation")
    if known is None:
        # The network gives the run its layers.
        flags = [*asked["flags"], "--initial", str(options.network)]
        summary = train(folder, options.steps * test // options.tests, flags)
        shutil.copyfile(folder.checkpoint, kept)
        known = {name: summary[name] for name in ("agent_steps", "wall_seconds")}
        write_json(note, asked | known)
    games = evaluate(kept, options.games, options.epsilon, to)
    return games | {"trained_steps": known["agent_steps"], "minutes": known["wall_seconds"] / 60}


def _kept(options: Options, folder: RunFolder, test: int) -> Path:
    """Returns the file of the network that plays in a test."""
    return folder.path / f"after-{options.steps * test // options.tests}.safetensors"


def held_from(curve: list[dict[str, Any]], least: float) -> dict[str, Any] | None:
    """Returns the first evaluation from which on all have a mean score of at least ``least``; None
    if the last one has less."""
    below = [index for index, each in enumerate(curve) if each["mean"] < least]
    return next(iter(curve[below[-1] + 1 :] if below else curve), None)


def training_flags(trained: RunConfig, steps: int) -> list[str]:
    """Returns the flags of a run in the world of ``trained``, with the settings of `ADAPTING`."""
    preset = PRESETS[ENVIRONMENTS.find(trained.env).preset]
    schedule = {
        "learning.annealing_steps": f"{steps}",
        "protocol.epoch_steps": f"{max(steps // _EPOCHS, 1)}",
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
