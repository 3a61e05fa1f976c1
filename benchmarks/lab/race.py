"""`python -m benchmarks.lab.race --env ale --seeds 3 --json FILE`: how soon training plays well.

One run after another trains from scratch for a fixed number of agent steps; keep the machine quiet
meanwhile. No evaluator disturbs them. Each run keeps its weights at intervals; afterwards all of
them play whole games, and the last ones also play the three evaluations of --headline. The same
command resumes what was interrupted, and a run's wall clock is the sum over its parts. Only a
learner ended by kill -9 loses the time since its last checkpoint.

`python -m benchmarks.figures.plot --figure race FILE …` draws the tests against the wall clock.
"""

import csv
import hashlib
import json
import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from benchmarks.lab.ladder import MILESTONES
from benchmarks.lab.policy import TrainingOptions, evaluate, headline, train
from benchmarks.peer_dqn import Point, peer_curve
from benchmarks.peers import is_installed
from benchmarks.report import (
    Report,
    Table,
    main,
    measure_missing,
    resumed,
    scored,
    with_time_left,
    write,
)
from common.checked import MAX_NAME, FromOne
from common.errors import InputError
from common.run.epochs import EpochTable
from common.run.folder import RunFolder
from common.settings.config import PresetName, ProtocolConfig
from learner.evaluation.options import GAMES, HEADLINE
from learner.evaluation.snapshots import Snapshots
from learner.phases import RECENT_GAMES

_PEER = "stable-baselines3 DQN"
_TEST_EPSILON = ProtocolConfig.test_epsilon
SHARED = ("env", "game", "preset", "learner", "steps", "every", "games")
"""Options that all results of a file share."""
_TOLD = ("preset", "agent_steps", "updates", "wall_seconds", "git_commit", "git_dirty", "machine")
"""Figures that are taken from a run's ``summary.json``."""


@dataclass(frozen=True)
class Options(TrainingOptions):
    """Train from scratch, and measure when training games and tests first had a mean of 0, of a
    human's 9.3 and of 18."""

    env: str = "robot"
    """Environment: the emulator alone, or the robot."""
    game: str = "pong"
    """Game: any that ale-py bundles."""
    preset: PresetName | None = None
    """Preset of the runs; by default that of the environment."""
    label: str = ""
    """Label of these settings in the figure's legend and the names of the runs."""
    steps: FromOne = 500_000
    """Length of each run, in agent steps, including the warm-up."""
    seeds: FromOne = 3
    """Number of runs, each with a seed of its own."""
    every: FromOne = 25_000
    """Agent steps between the weights that are tested."""
    games: FromOne = 5
    """Number of games in the test of each of these weights, with 0.05 random actions. The last
    weights also play the 90 games of --headline."""
    peer: bool = False
    """Also train stable-baselines3's DQN for as long as the longest run, with our warm-up and ε,
    and show its training games. It plays Pong by the emulator alone."""

    def check(self) -> None:
        super().check()
        if self.peer and (self.env, self.game) != ("ale", "pong"):
            raise InputError("--peer plays Pong by the emulator alone: omit it, or add --env ale.")

    def flags(self, seed: int) -> list[str]:
        """Returns the flags of a run's learner, without its folder and its steps."""
        preset = ["--preset", self.preset] if self.preset else []
        game = ["--env", self.env, "--game", self.game, "--seed", f"{seed}", "--evaluators", "0"]
        kept = ["--keep-snapshots", "--protocol.epoch-steps", f"{self.every}"]
        return [*preset, *game, *kept, *self.learner_flags]

    def folder(self, seed: int) -> RunFolder:
        alike = hashlib.sha256(repr([getattr(self, name) for name in SHARED]).encode())
        told = re.sub(r"[^a-z0-9]+", "-", f"race {self.env} {self.game} {self.label}".lower())
        unique = f"-{alike.hexdigest()[:8]}-seed-{seed}"
        return RunFolder(self.runs, told.strip("-")[: MAX_NAME - len(unique)] + unique)


def measure(options: Options) -> Report:
    about = {name: getattr(options, name) for name in SHARED} | {"epsilon": _TEST_EPSILON}
    found = resumed(options.json, about, "race of this budget and these flags")
    notes: list[str] = []

    asked = [{"seed": seed} for seed in range(options.seed, options.seed + options.seeds)]
    runs = measure_missing(options.json, found, "runs", asked, partial(_train, options))
    words = options.label or f"preset {runs[0]['preset']} {options.learner}".strip()
    found["title"] = f"{words} ({options.env})"
    if options.peer and not is_installed("stable_baselines3"):
        notes.append(f"{_PEER} is not installed, so not raced: pip install 'ale-robot[bench]'.")
    elif options.peer and "peer" not in found:
        found["peer"] = _train_peer(options, max(run["wall_seconds"] for run in runs))
        write(options.json, found)
    tests = [(run, test) for run in runs for test in run["tests"] if "mean" not in test]
    last = [(run, None) for run in runs if "headline" not in run]
    for run, test in with_time_left(
        [*tests, *last],
        lambda work: f"{'test' if work[1] else 'headline'} of seed {work[0]['seed']}",
        lambda work: options.games if work[1] else len(HEADLINE) * GAMES,
    ):
        _test(options, run, test)
        write(options.json, found)
    if options.json is not None:
        draw = f"python -m benchmarks.figures.plot --figure race {shlex.quote(str(options.json))}"
        notes.append(f"{draw} -o race.png draws it.")
    return Report(_tables(found), found, notes)


def _train(options: Options, seed: int) -> dict[str, Any]:
    folder, flags = options.folder(seed), options.flags(seed)
    interrupted = folder.checkpoint.exists()
    summary = train(folder, options.steps, flags)
    command = ["python", "-m", "learner", "--local", "--steps", f"{options.steps}", *flags]
    warm_up = summary["config"]["replay"]["learning_starts"]
    with folder.gates.open() as file:
        training = [
            (float(row["seconds"]), int(row["agent_steps"]), float(row["train_reward"]))
            for row in csv.DictReader(file)
            if float(row["games"]) >= RECENT_GAMES
        ]
    return {
        "command": shlex.join(command),
        "interrupted": interrupted,
        **{name: summary[name] for name in _TOLD},
        "steps_per_second": summary["agent_steps"] / summary["wall_seconds"],
        "updates_per_second": summary["updates"] / summary["wall_seconds"],
        "training": _reached(training),
        "test": _reached([]),  # until weights have played
        "tests": [
            {
                "epoch": row.epoch,
                "seconds": row.total_time,
                "agent_steps": row.agent_steps(warm_up),
            }
            for row in EpochTable(folder.epochs).rows()
            if row.phase == "train" and row.epoch  # not the warm-up, whatever its ε
        ],
    }


def _train_peer(options: Options, seconds: float) -> dict[str, Any]:
    print(f"training of {_PEER}, {seconds / 60:.0f} min", flush=True)
    folder = options.folder(options.seed)
    if (config := folder.stored_config()) is None:
        raise InputError(f"{folder.path}, which has the peer's warm-up and ε, is gone: race anew.")
    curve = peer_curve(config, seconds, RECENT_GAMES)
    return {"name": _PEER, "curve": curve, "training": _reached(curve)}


def _test(options: Options, run: dict[str, Any], test: dict[str, Any] | None) -> None:
    """Plays games with the weights of a ``test`` of ``run``; without one, the headline's games
    with its last weights."""
    folder = options.folder(run["seed"])
    if test is None:
        trained = json.loads(folder.summary.read_bytes())["updates"]
        if trained != run["updates"]:
            raise InputError(
                f"{folder.path} was trained on, to {trained:,} updates instead of "
                f"{run['updates']:,}: its last weights are gone; race anew with other --runs."
            )
        run["headline"] = headline(folder.checkpoint)
        return
    network = Snapshots(folder.snapshots).file(test["epoch"])
    found = evaluate(network, options.games, _TEST_EPSILON, quiet=True)
    test |= {name: found[name] for name in ("sticky", "mean", "deviation", "scores")}
    tested = [(t["seconds"], t["agent_steps"], t["mean"]) for t in run["tests"] if "mean" in t]
    run["test"] = _reached(tested)


def _reached(points: Sequence[Point]) -> dict[str, Any]:
    """Returns when each milestone was first reached; None for never."""
    first = {m: next((p for p in points if p[2] >= m), None) for m in MILESTONES.values()}
    return {f"{m:g}": p and {"seconds": p[0], "agent_steps": p[1]} for m, p in first.items()}


def _tables(found: dict[str, Any]) -> list[Table]:
    runs, peers = found["runs"], [found["peer"]] if "peer" in found else []
    recent, test = f"last {RECENT_GAMES} of training", f"test of {found['games']}"
    first = [
        {"run": run.get("name", f"seed {run.get('seed')}"), "games": games}
        | {
            f"≥ {score}": at and f"{at['seconds'] / 60:.1f} min, {at['agent_steps']:,}"
            for score, at in run[key].items()
        }
        for games, key, those in ((recent, "training", [*runs, *peers]), (test, "test", runs))
        for run in those
    ]
    last = [
        {"seed": run["seed"], "minutes": run["wall_seconds"] / 60}
        | {f"{name}/s": run[f"{name}_per_second"] for name in ("steps", "updates")}
        | {
            f"ε {row['epsilon']:g}, sticky {row['sticky']:g}": scored(row)
            for row in run["headline"]
        }
        for run in runs
    ]
    title = f"{found['title']}, {found['game']}"
    return [
        Table(f"{title}: wall clock and agent step at which a mean score was first reached", first),
        Table(f"{title}: the last weights after {found['steps']:,} steps", last),
    ]


if __name__ == "__main__":
    main("lab.race", Options, measure)
