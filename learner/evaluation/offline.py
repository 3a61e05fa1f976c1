"""Plays many whole games of one network, in several processes.

The number of games of each process is fixed before the first one starts. Taking whichever games end
first would overcount short games, which are defeats.
"""

import hashlib
import json
import subprocess
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, replace
from operator import itemgetter
from pathlib import Path
from queue import Empty, Queue
from typing import Any

from rich.console import Console

from common.atomic_file import write_json
from common.counted import counted
from common.errors import InputError, writing
from common.exit_codes import FAILED
from common.metrics import FOLLOWING_FRAMES, VALID_FRAMES
from common.minus import points
from common.network import build_network
from common.process.progress import Progress
from common.process.supervisor import Child
from common.run.network_file import load_network_file
from common.run.origin import name_of, origin_of
from common.settings.clock import ClockConfig
from common.settings.config import RunConfig
from common.settings.fit import SHAPING_SETTINGS
from common.settings.hands import keys_can_follow, latest_play
from common.settings.presets import PRESETS
from common.settings.stored_config import differences, to_json
from common.strict_json import strict
from learner.evaluation.options import EvaluationOptions
from learner.evaluation.results import ENDING, summarise, table
from learner.telemetry.formats import per_cent
from learner.telemetry.provenance import provenance

_POLL = 0.5


class Stopped(Exception):
    """The evaluation was stopped before all of its games had been played."""


def evaluate(
    network: Path,
    options: EvaluationOptions,
    config: RunConfig,
    clock: ClockConfig,
    stop: threading.Event,
    console: Console | None = None,
    name: str | None = None,
) -> dict[str, Any] | None:
    """Plays the games, prints the table and writes the JSON file.

    Args:
        network: file of the weights.
        config: settings to play under, which the network fits.
        name: what the results call the network; by default its file.

    Returns:
        The content of the JSON file; None if ``stop`` was set.

    Raises:
        InputError: the file is not of such a network, or the results cannot be written.
    """
    made_by = provenance()
    console = console or Console(highlight=False)
    origin = origin_of(network)
    trained = origin and origin.for_play
    load_network_file(build_network(config, config.action_count), network, "this game")
    # Before the games: a run that goes on writes its checkpoint anew meanwhile.
    sha256 = hashlib.sha256(network.read_bytes()).hexdigest()
    rows = _rows(network, options, config, trained, clock, stop, console)
    if rows is None:
        return None
    content: dict[str, Any] = {
        "weights": name or name_of(network),
        "sha256": sha256,
        # The games depend on these, as each process plays by a seed of its own.
        "seed": config.seed,
        "processes": options.at_once,
        "test_steps": options.test_steps,
        "flags": clock.flags(),
        **({"rows": rows} if options.headline else rows[0]),
        **made_by,
    }
    console.print(table(content))
    if (seen := min(row["valid_frame_share"] for row in rows)) < VALID_FRAMES.limit:
        console.print(
            f"The screen was found in {per_cent(seen, 1)} of the frames only: what was not seen "
            "cannot be played.",
            soft_wrap=True,
        )
    if min(row["following_frame_share"] for row in rows) < FOLLOWING_FRAMES.limit:
        console.print(
            "The frames mostly did not change as the game did: the camera may have stopped.",
            soft_wrap=True,
        )
    content = strict(content)
    if options.json is not None:
        with writing(options.json):
            write_json(options.json, content)
        console.print(f"wrote {options.json}", markup=False, soft_wrap=True)
    return content


def _rows(
    network: Path,
    options: EvaluationOptions,
    config: RunConfig,
    trained: RunConfig | None,
    clock: ClockConfig,
    stop: threading.Event,
    console: Console,
) -> list[dict[str, Any]] | None:
    """Plays the games of each measure; returns a row for each. If ``stop`` is set before all have
    been played, prints the rows that are whole, and returns None."""
    measures = options.measures(config, trained)
    rows, played = [], 0
    total = options.games * len(measures)
    at_once = f"{options.at_once} at a time; the time left follows with the first"
    begins = f"{counted(total, 'game')}, {at_once}"
    with Progress("evaluating", total, begins) as progress:
        for number, measure in enumerate(measures, 1):
            settings = replace(config, play=replace(config.play, sticky=measure.sticky))
            found: list[dict[str, Any]] = []
            try:
                for game in play(network, options, measure.epsilon, settings, clock.flags(), stop):
                    found.append(game)
                    played += 1
                    if not console.is_terminal:  # a log lists the games one by one
                        console.print(f"game {played}: score {points(game['score'])}")
                    later = options.games * (len(measures) - number)
                    total = played + max(options.games - len(found), 0) + later
                    note = f"{played} of {total} games, the last {points(game['score'])}"
                    progress.update(played, total=total, note=note)
            except Stopped:
                break
            # They come as they end; in this order a game stands beside the same in other worlds.
            found.sort(key=itemgetter("process"))
            known = trained and replace(trained, seed=config.seed)
            changed = differences(known, settings) if known else []
            told = {
                "changed": changed,
                "conditions": _unusual(settings),
                "keys_can_follow": keys_can_follow(latest_play(settings)),
            }
            rows.append({**asdict(measure), **told, **summarise(found, clock)})
    if len(rows) < len(measures):  # told once the bar has gone: the console would write behind it
        if rows:  # of the measures whose games are all there: those that end first are defeats
            console.print(table({"weights": name_of(network), "rows": rows}))
        scores = f" ({', '.join(points(game['score']) for game in found)})" if found else ""
        unwritten = f": {options.json} is not written" if options.json is not None else ""
        console.print(
            f"stopped after {counted(played, 'game')}{scores}{unwritten}",
            markup=False,
            soft_wrap=True,
        )
        return None
    return rows


def _unusual(settings: RunConfig) -> list[str]:
    """Returns the conditions in ``settings`` that differ from those of the preset."""
    preset = PRESETS[settings.preset]
    usual = replace(settings, play=preset.play, camera=preset.camera, randomise=preset.randomise)
    return [
        change
        for change in differences(usual, settings)
        if change.split()[0] not in SHAPING_SETTINGS
    ]


def play(
    network: Path,
    options: EvaluationOptions,
    epsilon: float,
    config: RunConfig,
    flags: Sequence[str],
    stop: threading.Event,
) -> Iterator[dict[str, Any]]:
    """Plays games in several processes, and yields them as they end.

    Args:
        network: file of the weights.
        epsilon: share of random actions.
        flags: additional flags of each playing process, such as ``["--no-sync"]``.

    Raises:
        InputError: a process failed.
        Stopped: ``stop`` was set, and a process had not yet played all that it was to play.
    """
    count = options.at_once
    owed = [
        [options.games // count + (at < options.games % count), -(-options.test_steps // count)]
        for at in range(count)
    ]
    arguments = {
        "--weights": network,
        "--settings": to_json(config),
        "--epsilon": epsilon,
        "--ending": ENDING,
    }
    lines: Queue[tuple[int, str | None]] = Queue()
    children = []
    with ExitStack() as end:
        for at, (games, steps) in enumerate(owed):
            own = {"--games": games, "--steps": steps, "--seed": config.seed * 1_000 + at}
            pairs = [str(part) for pair in (arguments | own).items() for part in pair]
            child = Child(
                *("actors.games", *pairs, *flags),
                leash=True,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
            )
            end.callback(child.end, 0.0)
            children.append(child)
            reader = threading.Thread(target=_read, args=(at, child, lines), daemon=True)
            reader.start()
            end.callback(reader.join)  # or its pipe would be closed while it reads
            end.callback(child.kill)
        playing = count
        while playing and not stop.is_set():
            try:
                at, line = lines.get(timeout=_POLL)
            except Empty:
                continue
            if line is not None:
                game = json.loads(line)
                owed[at] = [owed[at][0] - 1, owed[at][1] - game["steps"]]
                yield {"process": at, **game}
                continue
            playing -= 1
            status = children[at].wait()
            if status and not stop.is_set():  # one signal may end all processes
                why, code = children[at].last_line(), status
                if status < 0:
                    why, code = f"signal {-status} ended a process", FAILED
                raise InputError(f"the games could not be played: {why}.", code)
        if stop.is_set() and any(each > 0 for process in owed for each in process):
            raise Stopped


def _read(at: int, child: Child, lines: "Queue[tuple[int, str | None]]") -> None:
    assert child.stdout is not None
    for line in child.stdout:
        lines.put((at, line))
    lines.put((at, None))
