"""`python -m learner --evaluate FILE`: many whole games by one network, in several processes.

How many games each process plays is settled beforehand: would those be taken that end first, the
short ones, the defeats, would count too often.
"""

import dataclasses
import json
import os
import subprocess
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, Queue
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from common.errors import InputError
from common.press_latency import Delay
from common.process.supervisor import Child
from common.run.config import RunConfig, differences, to_json
from common.run.folder import write_atomically
from common.run.origin import origin_of
from learner.evaluation.scores import Scores
from learner.telemetry.provenance import Provenance
from learner.telemetry.sinks import formats as figures
from learner.telemetry.sinks.summary import strict

_POLL = 0.5


@dataclass(frozen=True)
class EvaluationOptions:
    """Test a network by whole games instead of training one."""

    evaluate: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """The network, such as runs/NAME/snapshots/best.safetensors. It plays under its run's settings,
    but for those that are given: another --env, a --play.command-latency, a --camera.noise, a
    --seed. --sync, --wait-action and --speed apply too."""
    games: int = 30
    """Games, over all processes."""
    test_steps: int = 0
    """Play on until so many steps are done, over all processes, as the report's tests do."""
    epsilon: float = 0.001
    """Share of random decisions; the report's tests have 0.05."""
    processes: int = 0
    """Games at a time; 0 for as many as there are cores."""
    json: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """File for the results."""

    def check(self) -> None:
        """Refuse what cannot be played.

        Raises:
            InputError: naming the flag.
        """
        if self.evaluate is not None and not self.evaluate.is_file():
            raise InputError(f"{self.evaluate} is no file: name a network to evaluate.")
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
    """Play, print the table and write the JSON; the exit status.

    Args:
        config: what to play under.
        flags: more for each playing process, such as ``["--no-sync"]``.

    Raises:
        InputError: the network cannot be played with.
    """
    assert options.evaluate is not None
    console = console or Console(highlight=False)
    changed = _changes(options.evaluate, config)
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
    content = _content(options, config, flags, changed, found)
    console.print(_table(content))
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


def _changes(weights: Path, config: RunConfig) -> list[str]:
    """In what other settings than it was trained under the network plays."""
    trained = origin_of(weights)
    return differences(dataclasses.replace(trained, seed=config.seed), config) if trained else []


def _content(
    options: EvaluationOptions,
    config: RunConfig,
    flags: Sequence[str],
    changed: list[str],
    games: list[dict[str, Any]],
) -> dict[str, Any]:
    assert options.evaluate is not None
    steps = sum(game["steps"] for game in games)
    late = {
        name: sum(game[name] for game in games)
        for name in ("decisions", "missed_deadlines", "late_frames")
    }
    key_times = tuple(map(sum, zip(*(game["key_times"] for game in games), strict=True)))
    return {
        "weights": str(options.evaluate),
        "epsilon": options.epsilon,
        "seed": config.seed,
        "flags": list(flags),
        "changed": changed,
        **dataclasses.asdict(Scores.of([game["score"] for game in games])),
        "steps": steps,
        "press_ms": dataclasses.asdict(Delay.of(key_times, "press")),
        "release_ms": dataclasses.asdict(Delay.of(key_times, "release")),
        "deadlines_kept_share": 1 - late["missed_deadlines"] / late["decisions"],
        "late_frames": late["late_frames"],
        "press_match_share": sum(game["matched"] for game in games) / steps,
        "valid_frame_share": sum(game["valid"] for game in games) / steps,
        "scores": [game["score"] for game in games],
        "steps_of_games": [game["steps"] for game in games],
        **dataclasses.asdict(Provenance.gather()),
    }


def _table(content: dict[str, Any]) -> Table:
    table = Table(title=f"{content['weights']}, ε = {content['epsilon']:g}", title_justify="left")
    table.add_column("")
    table.add_column("score", justify="right")
    low, high = content["iqm_low"], content["iqm_high"]
    release, press = (Delay(**content[name]) for name in ("release_ms", "press_ms"))
    hands = f"release {figures.delay(release)}, press {figures.delay(press)}"
    for name, cell in (
        *(("other than trained", change) for change in content["changed"]),
        ("games", f"{content['games']}"),
        ("mean ± deviation", f"{content['mean']:.2f} ± {content['deviation']:.2f}"),
        ("interquartile mean (95 %)", f"{content['iqm']:.2f} ({low:.2f} to {high:.2f})"),
        ("median", f"{content['median']:g}"),
        ("least, most", f"{content['least']:g}, {content['most']:g}"),
        ("steps", f"{content['steps']:,}"),
        ("keys as commanded", f"{content['press_match_share']:.1%}"),
        *((("command to keys, p50/p99 ms", hands),) if release.measured + press.measured else ()),
        *(
            (("deadlines kept", f"{content['deadlines_kept_share']:.2%}"),)
            if "--no-sync" in content["flags"]
            else ()
        ),
        ("frames valid", f"{content['valid_frame_share']:.1%}"),
        ("every game", " ".join(f"{score:g}" for score in content["scores"])),
    ):
        table.add_row(name, cell)
    return table
