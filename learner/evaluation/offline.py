"""`python -m learner --evaluate FILE`: many whole games by one network, in several processes.

How many games each process plays is fixed before the first starts. Taking the games that end first
would count short ones, which are defeats, too often.
"""

import json
import os
import subprocess
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from queue import Empty, Queue
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from common.errors import InputError
from common.process.supervisor import Child
from common.run.config import RunConfig, differences, to_json
from common.run.folder import write_atomically
from common.run.origin import origin_of
from learner.evaluation.results import summarise, table
from learner.telemetry.sinks.summary import strict

_POLL = 0.5


@dataclass(frozen=True)
class EvaluationOptions:
    """Test a network by whole games instead of training one."""

    evaluate: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Network to test, such as runs/NAME/snapshots/best.safetensors. It plays under its run's
    settings, except for those given here: another --env, a --play.command-latency, a
    --camera.noise, a --seed. --sync, --wait-action and --speed apply too."""
    games: int = 30
    """Number of games, over all processes."""
    test_steps: int = 0
    """Minimum number of agent steps, over all processes; the tests of 2017 played 125,000."""
    epsilon: float = 0.001
    """Share of random actions, 0 to 1; the tests of 2017 had 0.05."""
    processes: int = 0
    """Number of games played at a time; 0 for as many as there are cores."""
    json: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """File for the results, as JSON."""

    def check(self) -> None:
        """Refuse options that cannot be played.

        Raises:
            InputError: an option is out of bounds; it names the flag.
        """
        if self.evaluate is not None and not self.evaluate.is_file():
            raise InputError(f"{self.evaluate} is not a file: name a network to evaluate.")
        for name, value, least in (
            ("--games", self.games, 1),
            ("--test-steps", self.test_steps, 0),
            ("--processes", self.processes, 0),
        ):
            if value < least:
                raise InputError(f"{name} is {value}: choose {least} or more.")
        if not 0 <= self.epsilon <= 1:
            raise InputError(f"--epsilon is {self.epsilon}: choose a number from 0 to 1.")


def evaluate(
    options: EvaluationOptions,
    config: RunConfig,
    flags: Sequence[str],
    stop: threading.Event,
    console: Console | None = None,
) -> int:
    """Play, print the table and write the JSON; returns the exit status.

    Args:
        config: settings to play under.
        flags: more for each playing process, such as ``["--no-sync"]``.

    Raises:
        InputError: the network cannot be played with.
    """
    assert options.evaluate is not None
    console = console or Console(highlight=False)
    trained = origin_of(options.evaluate)
    changed = differences(replace(trained, seed=config.seed), config) if trained else []
    columns = (TextColumn("games"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    found: list[dict[str, Any]] = []
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("games", total=options.games)
        for game in play(options, config, flags, stop):
            found.append(game)
            progress.update(task, completed=len(found), total=max(options.games, len(found)))
    if stop.is_set():
        console.print(f"stopped after {len(found)} games")
        return 130
    about = {
        "weights": str(options.evaluate),
        "epsilon": options.epsilon,
        "seed": config.seed,
        "flags": list(flags),
        "changed": changed,
    }
    content = summarise(about, found)
    console.print(table(content))
    if options.json is not None:
        write_atomically(options.json, (json.dumps(strict(content), indent=2) + "\n").encode())
        console.print(f"wrote {options.json}")
    return 0


def play(
    options: EvaluationOptions, config: RunConfig, flags: Sequence[str], stop: threading.Event
) -> Iterator[dict[str, Any]]:
    """Yield games as they end, in several processes.

    Raises:
        InputError: a process ended by itself.
    """
    count = min(options.processes or len(os.sched_getaffinity(0)), options.games)
    arguments = {
        "--weights": options.evaluate,
        "--config": to_json(config),
        "--epsilon": options.epsilon,
        "--steps": -(-options.test_steps // count),
    }
    lines: Queue[tuple[int, str | None]] = Queue()
    children = []
    for at in range(count):
        own = {
            "--games": options.games // count + (at < options.games % count),
            "--seed": config.seed * 1_000 + at,
        }
        pairs = [str(part) for pair in (arguments | own).items() for part in pair]
        child = Child(
            *("actors.games", *pairs, *flags),
            leash=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        children.append(child)
        threading.Thread(target=_read, args=(at, child, lines), daemon=True).start()
    try:
        playing = count
        while playing and not stop.is_set():
            try:
                at, line = lines.get(timeout=_POLL)
            except Empty:
                continue
            if line is not None:
                yield {"process": at, **json.loads(line)}
                continue
            playing -= 1
            if children[at].wait() != 0:
                raise InputError(f"the games could not be played: {children[at].last_line()}.")
    finally:
        for child in children:
            child.kill()
            child.wait()


def _read(at: int, child: Child, lines: "Queue[tuple[int, str | None]]") -> None:
    assert child.stdout is not None
    for line in child.stdout:
        lines.put((at, line))
    lines.put((at, None))
