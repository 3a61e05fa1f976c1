"""``ale-robot status``, or ``python -m learner --status``: shows how a run is doing."""

import sys
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich import box
from rich.console import Console
from rich.table import Table

from common.checked import Patience
from common.command_line.parser import parse
from common.endpoint import DEFAULT_ENDPOINT
from common.errors import InputError, MessageError, Unreachable
from common.exit_codes import DONE, FAILED, UNREACHABLE
from common.metrics import METRICS
from common.process.program_end import exit_on_input_error
from common.protocol.run_keys import RunKeys
from common.protocol.run_status import RunStatus
from common.run.folder import MAX_LISTED, RUNS, RunFolder
from common.run.join import find_run
from common.run.newest_learner import NewestLearner
from common.strict_json import dumps
from common.transport.chosen import connect
from common.transport.interface import Transport
from common.version import VERSION, other_version
from learner.folder_report import FolderReport
from learner.telemetry.formats import (
    UNKNOWN,
    decimal,
    ended,
    figure,
    fill,
    one_line,
    played,
    reading_and_bound,
    scores,
)
from learner.telemetry.health_checks import reasons
from replay.chunk_statistics import ReplayProgress
from replay.messages import ProgressRequest

_LEAST_PATIENCE, _MAX_PATIENCE = 2.0, 3_600.0
"""Bounds on the seconds to wait for an answer."""


@dataclass(frozen=True)
class StatusOptions:
    """Show how a run is doing: its processes, their rates and lag, and what is wrong."""

    target: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[RUN]")] = None
    """Run, by its name or its folder on this machine. If nobody works at it here any more, the
    answer is how far it came."""
    connect: str | None = None
    """Address of the run's hub: the learner, or a replay in its own process; by default that of
    RUN, or else tcp/127.0.0.1:7447."""
    certificates: Path | None = None
    """Folder with a learner's certificates; needed if the address begins with tls/."""
    run: str | None = None
    """Name of the run; needed only if the hub serves several."""
    patience: Patience = 5.0
    """Seconds to wait for the hub, and then for each answer, at least 2."""
    json: bool = False
    """JSON instead of a table."""


@dataclass(frozen=True)
class Report:
    """What the processes of a run report."""

    run: str
    endpoint: str
    replay: ReplayProgress
    learner: RunStatus | None

    @property
    def reasons(self) -> list[str]:
        """Reasons why the run is not healthy; none if it is."""
        if self.learner is None:
            return ["no learner answers: unless it is just starting, start it again with --resume"]
        return reasons(self.learner.silent_for, self.learner.checks)

    def as_json(self) -> str:
        """Returns the whole report as JSON."""
        replay: dict[str, Any] = asdict(self.replay)
        del replay["statistics"]
        told = {
            "run": self.run,
            "state": "at work",
            "healthy": not self.reasons,
            "reasons": self.reasons,
            "version": VERSION,
            "replay": replay,
            "learner": self.learner
            and {
                **vars(self.learner),
                "checks": [check._asdict() for check in self.learner.checks],
                "actors": [actor._asdict() for actor in self.learner.actors],
            },
        }
        return dumps(told)

    def show(self, console: Console) -> None:
        """Prints the report for a person.

        Texts from other processes are stripped of control characters, so that they cannot steer
        the terminal.
        """
        learner, replay, idle = self.learner, self.replay, False

        def say(text: str, style: str = "") -> None:
            # Rich would leave a blank at the end of a line that it breaks.
            width = max(console.width, 1)  # it is 0 if COLUMNS is
            lines = textwrap.wrap(one_line(text), width, break_on_hyphens=False)
            console.print("\n".join(lines), style=style)

        words = f"run {self.run} at {self.endpoint}"
        if learner is None:
            say(words)
        else:
            values = {key: learner.values.get(key) for key in METRICS}
            say(f"{words}: {played(values)}")
            now = "preset {run/preset}, {run/phase}, epoch {run/epoch}, {run/agent_steps} steps"
            say(fill(now, values))
        columns = ("process", "state", "rate", "behind", "heard", "version")
        stored = f"{replay.stored:,} steps"
        rows = [("replay", stored, UNKNOWN, UNKNOWN, "now", replay.version), *_rows(learner)]
        # Versions are told if one is not this program's.
        told = len(columns) - all(row[-1] in (VERSION, UNKNOWN) for row in rows)
        table = Table(*columns[:told], box=box.SIMPLE, padding=(0, 1, 0, 0))
        for row in rows:
            table.add_row(*map(one_line, row[:told]))
        console.print(table)
        if learner is not None:
            stream = (
                "staleness {stream/staleness_p50}/{stream/staleness_p95} updates (p50/p95); "
                "samples per insert {stream/samples_per_insert}, "
                "target {stream/samples_per_insert_goal}; {stream/steps_per_second} steps/s"
            )
            say(fill(stream, values))
            say(scores(values))
            idle = not _has_actor(learner) and values["run/phase"] != "finishing"
            if idle:
                say(
                    "warning: nobody plays: start an actor by "
                    f"`ale-robot join --connect {self.endpoint}`"
                )
            for check in learner.checks:
                if check.passed is False and not check.stops:
                    say(f"warning: {check.name} is {reading_and_bound(check)}: {check.why}")
        for reason in self.reasons:
            say(f"RED: {reason}", "red")
        if not self.reasons:
            say("healthy, but nobody plays" if idle else "healthy", "yellow" if idle else "green")


def _has_actor(learner: RunStatus) -> bool:
    """Returns whether an actor plays, or one of local mode starts."""
    starting = learner.values.get("stream/actors_starting")
    return bool(starting) or any(each.alive and each.role == "actor" for each in learner.actors)


def _rows(learner: RunStatus | None) -> Iterator[tuple[str, ...]]:
    """Yields one row for the learner, one for each of its actors, and one for those of local mode
    that start."""
    if learner is None:
        yield ("learner", "does not answer", *[UNKNOWN] * 4)
        return
    state = figure("run/phase", learner.values)
    rate = fill("{learning/updates_per_second} updates/s", learner.values)
    yield "learner", state, rate, UNKNOWN, _ago(learner.silent_for), learner.version
    for actor in learner.actors:
        share = round(100 * actor.throttled_share)
        throttled = f", throttled {share}%" if share else ""
        yield (
            actor.name,
            f"{actor.role}{throttled}" if actor.alive else f"{actor.role}, {ended(actor.leaving)}",
            f"{decimal(actor.steps_per_second, 1)} steps/s",
            f"{actor.lag:,} updates" if actor.role == "actor" else UNKNOWN,
            _ago(actor.silent_for),
            actor.version,
        )
    if learner.values.get("stream/actors_starting"):
        yield fill("{stream/actors_starting} local", learner.values), "starting", *[UNKNOWN] * 4


def _ago(seconds: float) -> str:
    return "now" if seconds < 2 else f"{seconds:.0f} s ago"


def ask(
    transport: Transport, keys: RunKeys, endpoint: str, patience: float = _LEAST_PATIENCE
) -> Report:
    """Asks the processes of a run how they are doing, waiting ``patience`` seconds for each answer.

    Raises:
        Unreachable: the replay does not answer.
    """
    deadline = min(max(patience, _LEAST_PATIENCE), _MAX_PATIENCE)
    request = ProgressRequest().encode()
    replays = transport.gather(keys.progress, deadline, request)
    learners = transport.gather(keys.status, deadline)
    try:
        if not replays:
            raise Unreachable(
                f"the replay of {keys.run} does not answer: look at its log. At a tls/ address "
                "it answers only to a learner's certificate."
            )
        return Report(
            keys.run,
            endpoint,
            ReplayProgress.decode(replays[0].payload),
            RunStatus.decode(learners[0].payload) if learners else None,
        )
    except MessageError as error:
        raise Unreachable(f"{other_version(error)}.") from None


def _show_ended(run: FolderReport, *, as_json: bool) -> int:
    """Prints what is left of a run; returns the exit code."""
    if as_json:
        told = {"run": run.name, "healthy": False, "reasons": [run.reason], "version": VERSION}
        told |= {"state": run.how, "ended": run.written or None, "error": run.error or None}
        told |= {"summary": run.summary or None}
        print(dumps(told))
    else:
        for line in [*run.lines(), run.reason]:
            print(one_line(line))
    return UNREACHABLE


def _placed(options: StatusOptions, folder: RunFolder | None) -> StatusOptions:
    """Returns the options with the name and the address of the run that they ask for, which is that
    in ``folder``."""
    newest, name = None, options.run
    if folder is not None:
        newest, name = NewestLearner.of(folder), folder.name
    elif options.target is not None:
        name = options.target.name
    found = replace(
        options,
        run=name,
        connect=options.connect or (newest.endpoint if newest else DEFAULT_ENDPOINT),
    )
    if newest is not None and newest.certificates is not None and not options.certificates:
        found = replace(found, certificates=Path(newest.certificates))
    return found


def _asked(options: StatusOptions) -> Report:
    """Asks the run at an address. Raises InputError if there is none, or several."""
    assert options.connect is not None
    patience, certificates = options.patience, options.certificates
    with connect(options.connect, patience, role="learner", certificates=certificates) as transport:
        keys, _ = find_run(transport, options.run, patience, lambda: False, certificates)
        return ask(transport, keys, options.connect, patience)


def _folder_of(options: StatusOptions) -> RunFolder | None:
    """Returns the folder of the run that is asked for; None if it may be anywhere. Raises
    InputError if there is no such run, or if several work here and none was named."""
    if options.connect is not None:
        return None
    if options.target is not None:
        return RunFolder.existing(options.target).resolved()
    if options.run is not None:
        return None
    at_work = [run for run in RunFolder.all_in(RUNS) if _is_at_work(run)]
    if not at_work:
        return None
    if len(at_work) > 1:
        names = ", ".join(run.name for run in at_work[:MAX_LISTED])
        raise InputError(f"several runs are at work here: name one of {names}.")
    return at_work[0].resolved()


def _is_at_work(run: RunFolder) -> bool:
    """Whether somebody works at a run, as far as one may know."""
    try:
        return run.is_at_work()
    except OSError:  # such as another user's, whose locks cannot be opened
        return False


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the status of a run; returns the exit code, which says whether the run is healthy."""
    given = sys.argv[1:] if arguments is None else arguments
    options = parse(StatusOptions, "learner.status", given)
    if options.target is not None and options.run is not None:
        told = f"--run {options.run} names a run beside {options.target}: omit one of them."
        raise InputError(told)
    folder = _folder_of(options)
    if folder is not None and not folder.is_at_work():
        return _show_ended(FolderReport.of(folder), as_json=options.json)
    placed = _placed(options, folder)
    try:
        report = _asked(placed)
    except Unreachable as error:
        if folder is not None:
            raise Unreachable(
                f"somebody works at run {placed.run}, but nobody answers for it at "
                f"{placed.connect}: it may be starting or ending, so ask again; or give its "
                "address with --connect."
            ) from None
        known = ", ".join(run.name for run in RunFolder.all_in(RUNS)[:MAX_LISTED])
        if options.connect is None and known:
            raise Unreachable(f"{error} Runs here: {known}; `status RUN` asks one.") from None
        raise
    if options.json:
        print(report.as_json())
    else:
        report.show(Console(highlight=False, markup=False, emoji=False))
    return FAILED if report.reasons else DONE


if __name__ == "__main__":
    exit_on_input_error(main)
