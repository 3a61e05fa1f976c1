"""`python -m benchmarks.peers`: the same work by what one would pick instead, turn by turn.

* training of ALE-Only Pong: stable-baselines3's DQN against local mode
* the replay: cpprb's and stable-baselines3's against `replay.replay_buffer.ReplayBuffer`
* one Double DQN update: plain PyTorch in float32 against the algorithm `dqn`

What is not installed is passed over with a sentence: ``pip install 'ale-robot[bench]'``.
"""

import importlib.util
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Literal, get_args

import torch
from annotated_types import Ge, MinLen

from benchmarks import peer_dqn, peer_update
from benchmarks.child import scratch
from benchmarks.local_run import LocalRun, Setting
from benchmarks.pace import Spread, in_turns, slice_per_second
from benchmarks.peer_replays import Elsewhere, Who
from benchmarks.report import BenchmarkOptions, Number, Report, Seconds, main
from common.errors import InputError

Subject = Literal["training", "replay", "update"]

_NEEDED = {"stable_baselines3": "stable-baselines3", "cpprb": "cpprb"}
_SHORT_TURNS = 7
_SHORT_TURN = 0.5


@dataclass(frozen=True)
class Options(BenchmarkOptions):
    """Do the same work with others' code and with ours, in the same run."""

    only: Annotated[tuple[Subject, ...], MinLen(1)] = get_args(Subject)
    """What to compare."""
    seconds: Seconds = 15.0
    """Seconds of each turn of training."""
    turns: Number = 2
    """Number of turns of training."""
    replay_steps: Annotated[int, Ge(1_000)] = 20_000
    """Steps in each of the replays, of 56 KB in others' plain ones."""


def against_ours(work: str, rates: Mapping[str, list[float]]) -> list[dict[str, Any]]:
    """Returns each of ``rates``, turn by turn, but ``ours`` beside ours: how often per second."""
    median = {name: Spread.of(found).median for name, found in rates.items()}
    return [
        {
            "work": work,
            "peer": name,
            "peer/s": rate,
            "ours/s": median["ours"],
            "ratio": median["ours"] / rate,
        }
        for name, rate in median.items()
        if name != "ours"
    ]


def in_short_turns(
    work: str, contenders: Mapping[str, Callable[[float], float]]
) -> list[dict[str, Any]]:
    """Returns ``ours`` among ``contenders`` beside the others.

    Args:
        contenders: each works for so many seconds, and returns how often per second.
    """
    turns = {name: partial(rate, _SHORT_TURN) for name, rate in contenders.items()}
    return against_ours(work, in_turns(turns, _SHORT_TURNS))


def missing(package: str, what: str) -> str | None:
    """Why ``what`` is passed over; None if it need not be."""
    if importlib.util.find_spec(package) is not None:
        return None
    return f"{_NEEDED[package]} is not installed, so {what}: pip install 'ale-robot[bench]'."


def compare_training(options: Options) -> list[dict[str, Any]]:
    """Agent steps per second of training; each turn of ours is a run of its own.

    The peer plays and learns in one process, with one thread and with all: on a busy machine two
    threads are slower than one.
    """
    cores = torch.get_num_threads()
    peer = peer_dqn.PeerDQN()
    contenders: dict[str, Callable[[], float]] = {}
    for threads in sorted({1, cores}):
        peer.train(options.seconds / 3, threads)  # so that it is warm
        name = f"stable-baselines3 DQN, {threads} thread{'s' if threads > 1 else ''}"
        contenders[name] = partial(peer.train, options.seconds, threads)
    contenders["ours"] = partial(our_training, options.seconds)
    found = in_turns(contenders, options.turns, warm_up=0)
    torch.set_num_threads(cores)
    return against_ours("training steps, Pong", found)


def our_training(seconds: float) -> float:
    """Returns the training steps per second of a local run."""
    with LocalRun(Setting()) as run:
        run.settle()
        return run.measure(seconds).train_steps_per_second


def compare_replays(options: Options, packages: set[str]) -> list[dict[str, Any]]:
    """Inserts, uniform draws, prioritised draws with new priorities."""
    uniform: list[Who] = ["ours"]
    rated: list[Who] = ["ours"]
    if "cpprb" in packages:
        uniform += ["cpprb", "cpprb-stacks", "cpprb-states"]
        rated += ["cpprb-stacks", "cpprb-states"]
    if "stable_baselines3" in packages:
        uniform += ["stable-baselines3"]
    found: list[dict[str, Any]] = []
    works: tuple[tuple[str, Literal["insert", "draw"], list[Who], bool], ...] = (
        ("insert steps", "insert", uniform, False),
        ("draw batches of 32", "draw", uniform, False),
        ("draw and rate them", "draw", rated, True),
    )
    for name, work, whos, prioritised in works:
        with ExitStack() as stack:
            folder = stack.enter_context(scratch())
            replays = [
                stack.enter_context(
                    Elsewhere(who, options.replay_steps, folder, prioritised=prioritised)
                )
                for who in whos
            ]
            found += in_short_turns(name, {each.name: partial(each.rate, work) for each in replays})
    return found


def compare_updates() -> list[dict[str, Any]]:
    """Updates of batches of 32, on one thread and on all."""
    found = []
    cores = torch.get_num_threads()
    for threads in sorted({1, cores}):
        torch.set_num_threads(threads)
        found += in_short_turns(
            f"updates of 32, {threads} thread{'s' if threads > 1 else ''}",
            {
                "PyTorch eager float32": partial(slice_per_second, peer_update.eager()),
                "ours": partial(slice_per_second, peer_update.ours()),
            },
        )
    torch.set_num_threads(cores)
    return found


def measure(options: Options) -> Report:
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
    found: list[dict[str, Any]] = []
    if "training" in options.only and "stable_baselines3" in packages:
        found += compare_training(options)
    if "replay" in options.only and packages:
        found += compare_replays(options, packages)
    if "update" in options.only:
        found += compare_updates()
    if not found:
        raise InputError(" ".join(skipped))
    title = f"Peers and us, turn by turn, in {time.monotonic() - began:.0f} s"
    return Report.of(title, found, {"skipped": skipped}, *skipped)


if __name__ == "__main__":
    main("peers", Options, measure)
