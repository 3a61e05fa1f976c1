"""`python -m benchmarks.peers`: the same work by other libraries and by this one, turn by turn.

* training of ALE-Only Pong: stable-baselines3's DQN against local mode
* the replay: cpprb's and stable-baselines3's against `replay.replay_buffer.ReplayBuffer`
* one Double DQN update: plain PyTorch in float32 against the algorithm `dqn`

A library that is not installed is skipped with a note: ``pip install 'ale-robot[bench]'``.
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

from benchmarks import peer_update
from benchmarks.child import Helper, scratch
from benchmarks.local_run import LocalRun, Setting
from benchmarks.pace import Spread, in_turns, slice_per_second
from benchmarks.peer_dqn import peer_dqn
from benchmarks.peer_replays import REPLAYS
from benchmarks.report import BenchmarkOptions, Report, Seconds, main
from common.checked import FromOne
from common.counted import counted
from common.errors import InputError
from common.settings.config import PresetName

Subject = Literal["training", "replay", "update"]

_PEERS: tuple[tuple[Subject, str, str], ...] = (
    ("training", "stable_baselines3", "stable-baselines3"),
    ("replay", "stable_baselines3", "stable-baselines3"),
    ("replay", "cpprb", "cpprb"),
)
"""Subjects that are compared with a package, and the name by which it is installed."""
_SHORT_TURNS = 7
_SHORT_TURN = 0.5


@dataclass(frozen=True)
class Options(BenchmarkOptions):
    """Do the same work with other libraries and with this one, in the same run."""

    only: Annotated[tuple[Subject, ...], MinLen(1)] = get_args(Subject)
    """Subjects to compare."""
    seconds: Seconds = 15.0
    """Length of each turn of training, in seconds."""
    turns: FromOne = 2
    """Number of turns of training."""
    replay_steps: Annotated[int, Ge(1_000)] = 20_000
    """Steps in each replay; in the others' plain replays a step takes 56 KB."""


def against_ours(work: str, rates: Mapping[str, list[float]]) -> list[dict[str, Any]]:
    """Returns a row for each of ``rates`` but ``ours``, with the ratio of the medians.

    Rates are per second.
    """
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
    """Measures ``contenders`` in short turns; returns the rows that compare them with ``ours``.

    Args:
        contenders: functions that work for the given seconds and return a rate per second.
    """
    turns = {name: partial(rate, _SHORT_TURN) for name, rate in contenders.items()}
    return against_ours(work, in_turns(turns, _SHORT_TURNS))


def is_installed(package: str | None) -> bool:
    """Whether a package is installed; None stands for this project."""
    return package is None or importlib.util.find_spec(package) is not None


def compare_training(options: Options) -> list[dict[str, Any]]:
    """Compares the agent steps per second of training, eight samples of each; each of our turns is
    a run of its own: by the peer's minibatches, 32 transitions every 4 agent steps, and by those of
    the preset ``fast``.

    The peer plays and learns in one process. It is measured with one thread and with all, because
    on a busy machine two threads are slower than one.
    """
    cores = torch.get_num_threads()
    train = peer_dqn()
    contenders: dict[str, Callable[[], float]] = {}
    for threads in sorted({1, cores}):
        train(options.seconds / 3, threads)  # warms up
        name = f"stable-baselines3 DQN, {counted(threads, 'thread')}"
        contenders[name] = partial(train, options.seconds, threads)
    peers = [*contenders]
    presets: dict[PresetName, str] = {"paper": "minibatches of 32", "fast": "ours of 128"}
    contenders |= {name: partial(our_training, name, options.seconds) for name in presets}
    found = in_turns(contenders, options.turns, warm_up=0)
    torch.set_num_threads(cores)
    return [
        row
        for name, minibatches in presets.items()
        for row in against_ours(
            f"training steps, Pong, {minibatches}",
            {**{peer: found[peer] for peer in peers}, "ours": found[name]},
        )
    ]


def our_training(preset: PresetName, seconds: float) -> float:
    """Returns the training steps per second of a local run of ALE-Only by ``preset``."""
    with LocalRun(Setting(preset=preset)) as run:
        run.settle()
        return run.measure(seconds).train_steps_per_second


def compare_replays(options: Options) -> list[dict[str, Any]]:
    """Compares inserts, uniform draws, and prioritised draws with new priorities."""
    found: list[dict[str, Any]] = []
    works: tuple[tuple[str, Literal["insert", "draw"], bool], ...] = (
        ("insert steps", "insert", False),
        ("draw batches of 32", "draw", False),
        ("draw and rate them", "draw", True),
    )
    for name, work, prioritised in works:
        with ExitStack() as stack:
            folder = stack.enter_context(scratch())
            contenders = {}
            for who, peer in REPLAYS.items():
                if is_installed(peer.package) and (peer.rated or not prioritised):
                    replay = Helper(
                        who,
                        "benchmarks.peer_replays",
                        who=who,
                        size=options.replay_steps,
                        folder=str(folder),
                        prioritised=prioritised,
                    )
                    contenders[who] = partial(stack.enter_context(replay).ask, work)
            found += in_short_turns(name, contenders)
    return found


def compare_updates() -> list[dict[str, Any]]:
    """Compares updates with batches of 32, on one thread and on all."""
    found = []
    cores = torch.get_num_threads()
    for threads in sorted({1, cores}):
        torch.set_num_threads(threads)
        found += in_short_turns(
            f"updates of 32, {counted(threads, 'thread')}",
            {
                "PyTorch eager float32": partial(slice_per_second, peer_update.eager()),
                "ours": partial(slice_per_second, peer_update.ours()),
            },
        )
    torch.set_num_threads(cores)
    return found


def measure(options: Options) -> Report:
    began = time.monotonic()
    skipped = [
        f"{name} is not installed, so its {subject} is not compared: "
        "pip install 'ale-robot[bench]'."
        for subject, package, name in _PEERS
        if subject in options.only and not is_installed(package)
    ]
    found: list[dict[str, Any]] = []
    if "training" in options.only and is_installed("stable_baselines3"):
        found += compare_training(options)
    if "replay" in options.only and any(is_installed(name) for _, name, _ in _PEERS):
        found += compare_replays(options)
    if "update" in options.only:
        found += compare_updates()
    if not found:
        raise InputError(" ".join(skipped))
    title = f"Peers and us, turn by turn, in {time.monotonic() - began:.0f} s"
    return Report.of(title, found, {"skipped": skipped}, *skipped)


if __name__ == "__main__":
    main("peers", Options, measure)
