"""`python -m benchmarks.peers`: the same work by what one would pick instead, turn by turn.

* training of ALE-Only Pong: stable-baselines3's DQN against local mode
* the replay: cpprb's and stable-baselines3's against `replay.replay_buffer.ReplayBuffer`
* one Double DQN update: plain PyTorch in float32 against the algorithm `dqn`

What is not installed is passed over with a sentence: ``pip install 'ale-robot[bench]'``.
"""

import importlib.util
import tempfile
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import numpy as np
import torch
import tyro

from benchmarks import peer_dqn, peer_update
from benchmarks.child import end_as_by_ctrl_c
from benchmarks.local_run import LocalRun, Setting
from benchmarks.pace import slice_per_second
from benchmarks.peer_replays import Elsewhere, Who
from benchmarks.report import publish
from common.errors import InputError, exit_on_input_error

Subject = Literal["training", "replay", "update"]

_NEEDED = {"stable_baselines3": "stable-baselines3", "cpprb": "cpprb"}
PREFIX = "ale-robot-bench-"
_SHORT_TURNS = 7
_SHORT_TURN = 0.5


@dataclass(frozen=True)
class Options:
    """Do the same work with others' code and with ours, in the same run."""

    only: tuple[Subject, ...] = get_args(Subject)
    """What to compare."""
    seconds: float = 15.0
    """Of each turn of training."""
    turns: int = 2
    """Turns of training."""
    replay_steps: int = 20_000
    """Steps in each of the replays, of 56 KB in others' plain ones."""
    json: Path | None = None
    """File for the results."""

    def check(self) -> None:
        if not self.seconds > 0 or self.turns < 1:
            raise InputError("choose seconds above 0, and 1 or more turns.")
        if self.replay_steps < 1_000:
            raise InputError(f"--replay-steps is {self.replay_steps}: choose 1000 or more.")
        if not self.only:
            raise InputError("--only: choose one of training, replay and update.")


class Contender(NamedTuple):
    """Someone who can do a piece of work again and again."""

    name: str
    rate: Callable[[float], float]
    """Does it for so many seconds; how often per second."""


class Comparison(NamedTuple):
    """One piece of work, done by a peer and by us: how much of it per second."""

    work: str
    peer: str
    peer_per_second: float
    ours_per_second: float

    @property
    def ratio(self) -> float:
        return self.ours_per_second / self.peer_per_second


def in_turns(contenders: Iterable[Contender], turns: int, seconds: float) -> dict[str, float]:
    """How often per second each does it: the median turn's, after a turn that does not count."""
    contenders = list(contenders)
    rates: dict[str, list[float]] = {each.name: [] for each in contenders}
    for turn in range(turns + 1):
        for each in contenders:
            rate = each.rate(seconds)
            if turn:
                rates[each.name].append(rate)
    return {name: float(np.median(found)) for name, found in rates.items()}


def against_ours(work: str, rates: dict[str, float]) -> list[Comparison]:
    """Each of ``rates`` but ``ours`` beside ours."""
    ours = rates["ours"]
    return [Comparison(work, name, rate, ours) for name, rate in rates.items() if name != "ours"]


def missing(package: str, what: str) -> str | None:
    """Why ``what`` is passed over; None if it need not be."""
    if importlib.util.find_spec(package) is not None:
        return None
    return f"{_NEEDED[package]} is not installed, so {what}: pip install 'ale-robot[bench]'."


def compare_training(options: Options) -> list[Comparison]:
    """Agent steps per second of training; each turn of ours is a run of its own.

    The peer plays and learns in one process, with one thread and with all: on a busy machine two
    threads are slower than one.
    """
    cores = torch.get_num_threads()
    peer = peer_dqn.PeerDQN()
    theirs: dict[int, list[float]] = {threads: [] for threads in sorted({1, cores})}
    ours: list[float] = []
    for threads in theirs:
        peer.train(options.seconds / 3, threads)
    for _ in range(options.turns):
        for threads, rates in theirs.items():
            rates.append(peer.train(options.seconds, threads))
        with (
            tempfile.TemporaryDirectory(prefix=PREFIX) as folder,
            LocalRun(Setting(), Path(folder)) as run,
        ):
            run.settle()
            ours.append(run.measure(options.seconds).train_steps_per_second)
    torch.set_num_threads(cores)
    return against_ours(
        "training steps, Pong",
        {
            **{
                f"stable-baselines3 DQN, {threads} thread{'s' if threads > 1 else ''}": float(
                    np.median(rates)
                )
                for threads, rates in theirs.items()
            },
            "ours": float(np.median(ours)),
        },
    )


def compare_replays(options: Options, packages: set[str]) -> list[Comparison]:
    """Inserts, uniform draws, prioritised draws with new priorities."""
    uniform: list[Who] = ["ours"]
    rated: list[Who] = ["ours"]
    if "cpprb" in packages:
        uniform += ["cpprb", "cpprb-stacks", "cpprb-states"]
        rated += ["cpprb-stacks", "cpprb-states"]
    if "stable_baselines3" in packages:
        uniform += ["stable-baselines3"]
    found: list[Comparison] = []
    works: tuple[tuple[str, Literal["insert", "draw"], list[Who], bool], ...] = (
        ("insert steps", "insert", uniform, False),
        ("draw batches of 32", "draw", uniform, False),
        ("draw and rate them", "draw", rated, True),
    )
    for name, work, whos, prioritised in works:
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix=PREFIX)))
            replays = [
                stack.enter_context(
                    Elsewhere(who, options.replay_steps, folder, prioritised=prioritised)
                )
                for who in whos
            ]
            contenders = [Contender(each.name, partial(each.rate, work)) for each in replays]
            found += against_ours(name, in_turns(contenders, _SHORT_TURNS, _SHORT_TURN))
    return found


def compare_updates() -> list[Comparison]:
    """Updates of batches of 32, on one thread and on all."""
    found = []
    cores = torch.get_num_threads()
    for threads in sorted({1, cores}):
        torch.set_num_threads(threads)
        eager, ours = peer_update.eager(), peer_update.ours()
        rates = in_turns(
            [
                Contender("PyTorch eager float32", partial(slice_per_second, eager)),
                Contender("ours", partial(slice_per_second, ours)),
            ],
            _SHORT_TURNS,
            _SHORT_TURN,
        )
        torch.set_num_threads(cores)
        work = f"updates of 32, {threads} thread{'s' if threads > 1 else ''}"
        found += against_ours(work, rates)
    return found


def main() -> None:
    options = tyro.cli(Options, prog="python -m benchmarks.peers")
    options.check()
    end_as_by_ctrl_c()
    began = time.monotonic()
    packages = {package for package in _NEEDED if missing(package, "") is None}
    skipped = [
        reason
        for subject, package, what in (
            ("training", "stable_baselines3", "its training is not compared"),
            ("replay", "stable_baselines3", "its replay is not compared"),
            ("replay", "cpprb", "its replays are not compared"),
        )
        if subject in options.only and (reason := missing(package, what)) is not None
    ]
    found: list[Comparison] = []
    if "training" in options.only and "stable_baselines3" in packages:
        found += compare_training(options)
    if "replay" in options.only and packages:
        found += compare_replays(options, packages)
    if "update" in options.only:
        found += compare_updates()
    for reason in skipped:
        print(reason)
    if not found:
        return
    publish(
        f"Peers and us, turn by turn, in {time.monotonic() - began:.0f} s",
        [
            {
                "work": each.work,
                "peer": each.peer,
                "peer/s": each.peer_per_second,
                "ours/s": each.ours_per_second,
                "ratio": each.ratio,
            }
            for each in found
        ],
        options.json,
        {
            "comparisons": [{**each._asdict(), "ratio": each.ratio} for each in found],
            "skipped": skipped,
        },
    )


if __name__ == "__main__":
    exit_on_input_error(main)
