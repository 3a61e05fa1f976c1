"""The one screen of a run: every figure of a `Status`, laid out for the terminal's size.

At 80 × 24 all of it fits; a larger terminal shows more actors, more events and a taller chart.
Nothing wraps, so the number of lines is known before they are drawn.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.progress_bar import ProgressBar
from rich.rule import Rule
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

from learner.telemetry.sinks import formats as figures
from learner.telemetry.status import ActorStatus, Gate, Status, TimeCounts

_WIDEST = 132
_ECHO = 2
"""Columns left free: a terminal writes ^C behind the last line, which must not wrap."""
_ACCENT, _GOOD, _BAD, _LABEL, _LINE = "cyan", "green", "bold red", "dim", "dim"
_ROOMY = 108
"""Columns from which actors tell more about themselves."""

_ROWS = 23
"""Lines at 80 × 24: one is left for the cursor."""
_FIGURE_ROWS = 6
_GATE_ROWS = 7
_NOTE_ROWS = 2


@dataclass(frozen=True)
class _Room:
    """Lines that each part may take."""

    figures: int = _FIGURE_ROWS
    chart: int = 1
    actors: int = _GATE_ROWS
    notes: int = _NOTE_ROWS
    titled_notes: bool = False
    loose: bool = False
    """With a gap below the header and above the figures, too."""


def _share_out(extra: int, actors: int) -> _Room:
    """Give ``extra`` lines to the parts that gain most by them."""

    def take(wanted: int) -> int:
        nonlocal extra
        given = min(max(wanted, 0), max(extra, 0))
        extra -= given
        return given

    loose = extra >= 2
    take(2 if loose else 0)
    titled = extra >= 2
    take(2 if titled else 0)
    more_figures = take(2)
    # A chart of several lines has a title and a gap, which the single line has not.
    chart = take(5) - 1 if extra >= 5 else 1
    more_actors = take(actors - _GATE_ROWS)
    if chart > 1:
        chart += take(4)
    return _Room(
        figures=_FIGURE_ROWS + more_figures,
        chart=chart,
        actors=_GATE_ROWS + more_actors,
        notes=_NOTE_ROWS + take(6),
        titled_notes=titled,
        loose=loose,
    )


class Screen:
    """A renderable of ``status`` that never has more lines than the console, less one."""

    def __init__(self, status: Status) -> None:
        self._status = status

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        width, rows = min(options.max_width - _ECHO, _WIDEST), max(console.size.height - 1, 1)
        lines: list[list[Segment]] = []
        for part in _parts(self._status, width, rows):
            lines += console.render_lines(part, options.update(width=width), pad=False)
        for number, line in enumerate(lines[:rows]):
            if number:
                yield Segment.line()
            yield from line


def _parts(status: Status, width: int, rows: int) -> Iterable[RenderableType]:
    room = _share_out(rows - _ROWS, len(status.present))
    gap = [Text()] if room.loose else []
    yield _header(status)
    yield from gap
    yield _progress(status)
    yield from gap
    yield _figures(status, room.figures)
    if room.chart > 1:
        yield Text()
    yield from _history(status, width, room.chart)
    yield Text()
    yield _people_and_gates(status, width, room.actors)
    if room.titled_notes:
        yield Text()
        yield _title("Events")
    yield _events(status, room.notes)


def _text(text: str, style: str = "") -> Text:
    return Text(figures.one_line(text), style, no_wrap=True, overflow="ellipsis", end="")


def _title(text: str) -> Rule:
    return Rule(Text(text, "bold"), align="left", style=_LINE)


def _grid(*columns: Column, gap: int = 1, expand: bool = True) -> Table:
    for column in columns:
        column.no_wrap, column.overflow = True, "ellipsis"
    return Table(
        *columns, box=None, show_header=False, expand=expand, pad_edge=False, padding=(0, gap, 0, 0)
    )


def _header(status: Status) -> Table:
    title = Text("ALE-Robot" if status.env == "robot" else "ALE-Only", f"bold {_ACCENT}")
    title.append(f"  {status.game}", "bold default")
    title.append(f"  run {status.run}", "default")
    grid = _grid(Column(ratio=1), Column(justify="right"))
    grid.add_row(title, _text(f"{status.preset} preset · {status.device}", _LABEL))
    return grid


def _progress(status: Status) -> Table:
    if status.phase == "warm-up":
        label, done, total = "Warm-up", status.warmup_done, status.warmup
    else:
        label, done, total = f"Epoch {status.epoch}", status.epoch_done, status.epoch_steps
    if status.phase == "finishing":
        left = "finishing"
    else:
        left = f"{figures.duration(status.remaining)} left"
    grid = _grid(
        Column(min_width=9),
        Column(ratio=1),
        Column(justify="right", min_width=5),
        Column(justify="right", min_width=12),
        Column(justify="left"),
        Column(justify="right", min_width=14),
    )
    _bar_row(grid, label, done, total, left)
    elapsed = figures.duration(status.elapsed) + " so far"
    if status.steps_goal is None:
        grid.add_row(
            _text("Run", "bold"),
            _text("until stopped", _LABEL),
            "",
            figures.count(status.agent_steps),
            _text("steps", _LABEL),
            _text(elapsed, _LABEL),
        )
    else:
        _bar_row(grid, "Run", status.agent_steps, status.steps_goal, elapsed)
    _bar_row(grid, "Replay", status.stored, status.capacity, "")
    return grid


def _bar_row(grid: Table, label: str, done: int, total: int, right: str) -> None:
    bar = ProgressBar(
        max(total, 1), min(done, total), complete_style=_ACCENT, finished_style=_ACCENT
    )
    grid.add_row(
        _text(label, "bold"),
        bar,
        figures.share(done, total),
        figures.count(done),
        _text(f"of {figures.count(total)}", _LABEL),
        _text(right, _LABEL),
    )


def _figures(status: Status, rows: int) -> Table:
    chunks = status.chunks
    tested = "" if status.test_epoch is None else f", epoch {status.test_epoch}"
    best = max(status.test_history, default=None)
    stale = (figures.decimal(lag, 0) for lag in (status.staleness_p50, status.staleness_p95))
    samples = figures.decimal(status.samples_per_insert, 2)
    hands = [
        ("release p50/p99", figures.delay(status.release)),
        ("press p50/p99", figures.delay(status.press)),
    ]
    # The first `_FIGURE_ROWS` of each are always shown.
    play = [
        (f"test{tested}", figures.decimal(status.test_reward, 2)),
        ("train", figures.decimal(status.train_reward, 2)),
        ("random policy", figures.decimal(status.random_reward, 2)),
        ("games", figures.count(status.games)),
        *(hands if status.env == "robot" else ()),
        ("best test", figures.decimal(best, 2)),
        ("keys matched", figures.decimal(status.press_match_share, 3)),
    ]
    learning = [
        ("mean max-Q", figures.decimal(status.mean_max_q, 3)),
        ("its deviation", figures.significant(status.held_out_std)),
        ("loss", figures.significant(status.loss)),
        ("updates", figures.count(status.updates)),
        ("updates/s", figures.decimal(status.updates_per_second, 1)),
        ("exploration ε", figures.decimal(status.epsilon, 3)),
        ("weights no.", figures.count(status.weights_version)),
        ("frames valid", figures.decimal(status.valid_frame_share, 3)),
    ]
    stream = [
        ("steps/s", figures.decimal(status.steps_per_second, 1)),
        ("samples/insert", f"{samples} of {status.samples_per_insert_goal:g}"),
        ("stale p50/p95", " / ".join(stale)),
        ("chunks acked", figures.count(chunks.acked)),
        ("retried", figures.count(chunks.retried)),
        ("duplicate", figures.count(chunks.duplicate)),
        ("made", figures.count(chunks.made)),
        ("refused", figures.count(chunks.refused)),
    ]
    grid = _grid(Column(ratio=1), Column(ratio=1), Column(ratio=1), gap=3)
    grid.add_row(
        *(
            _group(title, pairs[:rows])
            for title, pairs in (("Reward", play), ("Learning", learning), ("Stream", stream))
        )
    )
    return grid


def _group(title: str, pairs: Sequence[tuple[str, str]]) -> Table:
    grid = _grid(Column(), Column(ratio=1, justify="right"))
    for label, value in pairs:
        grid.add_row(_text(label, _LABEL), _text(value))
    return _titled(title, grid)


def _titled(title: str, body: RenderableType) -> Table:
    grid = _grid(Column(ratio=1), gap=0)
    grid.add_row(_title(title))
    grid.add_row(body)
    return grid


def _history(status: Status, width: int, rows: int) -> Iterable[RenderableType]:
    """The rewards so far, epoch by epoch; those not above the random policy's are dim."""
    name, values = "Test", status.test_history
    if not values:
        name, values = "Train", status.train_history
    if rows > 1:
        yield _title(f"{name} reward by epoch")
    if not values:
        yield _text("no epoch is over yet", _LABEL)
        yield from [Text()] * (rows - 1)
        return
    known = [*values, *([] if status.random_reward is None else [status.random_reward])]
    low, high = min(known), max(known)
    top, bottom = figures.decimal(high, 1), figures.decimal(low, 1)
    if rows == 1:
        labels = [f"{name.lower()} {bottom} … {top}"]
    else:
        labels = [top, *[""] * (rows - 2), bottom]
    margin = max(map(len, labels))
    heights = figures.columns_of(values, width - margin - 2)
    floor = low if status.random_reward is None else status.random_reward
    for label, blocks in zip(labels, figures.bars(heights, low, high, rows), strict=True):
        line = Text(no_wrap=True, overflow="crop")
        line.append(f"{label:>{margin}}  ", _LABEL)
        for block, value in zip(blocks, heights, strict=True):
            line.append(block, _ACCENT if value > floor else _LABEL)
        yield line


def _people_and_gates(status: Status, width: int, rows: int) -> Table:
    alive = sum(actor.alive for actor in status.present)
    failed, unknown = len(status.failed_gates), sum(g.passed is None for g in status.gates)
    if not status.gates:
        verdict = "none yet"
    else:
        verdict = f"{failed} red" if failed else f"{unknown} open" if unknown else "all green"
    grid = _grid(Column(ratio=1), Column(width=38), gap=3)
    grid.add_row(
        _titled(
            f"Actors {alive}/{len(status.present)}{troubles}"
            if (troubles := time_troubles(status.time))
            else f"Actors, {alive} of {len(status.present)} alive",
            _actors(status.present, rows, roomy=width >= _ROOMY),
        ),
        _titled(f"Gates, {verdict}", _gates(status.gates)),
    )
    return grid


def time_troubles(time: TimeCounts | ActorStatus) -> str:
    """What went wrong with time, if anything did, each after a comma."""
    late, given_up = time.missed_deadlines + time.late_frames, time.waits_given_up
    told = [f", {_brief(late)} late"] if late else []
    return "".join([*told, f", {_brief(given_up)} gave up"] if given_up else told)


def _brief(count: int) -> str:
    """In four characters: at 80 columns there is no room for more."""
    for unit, name in ((1_000_000, "M"), (1_000, "k")):
        if count >= unit:
            return f"{count / unit:.{1 if count < 10 * unit else 0}f}{name}"
    return str(count)


def _actors(actors: Sequence[ActorStatus], rows: int, roomy: bool) -> Table:
    right = [Column(justify="right") for _ in range(5 if roomy else 2)]
    grid = _grid(Column(width=1), Column(ratio=1, min_width=8), *right, gap=2 if roomy else 1)
    # The lost ones first: they must not be among those for which there is no room.
    order = sorted(actors, key=lambda actor: (actor.alive, actor.role, _natural(actor.name)))
    shown = order if len(order) <= rows else order[: rows - 1]
    for actor in shown:
        style = "" if actor.alive else _BAD
        rate = f"{figures.decimal(actor.steps_per_second, 1)}/s" if actor.alive else "lost"
        cells = [_text(figures.count(actor.steps)), _text(rate)]
        if roomy:
            cells += [
                _text(f"ε {figures.decimal(actor.epsilon, 3)}"),
                _text(f"{figures.count(actor.retried)} retried{time_troubles(actor)}", _LABEL),
                _text(f"silent {actor.silent_for:.0f} s", _LABEL),
            ]
        mark = Text("●", _GOOD) if actor.alive else Text("○", _BAD)
        for cell in cells:
            cell.stylize(style)
        grid.add_row(mark, _text(actor.name, style), *cells)
    if len(shown) < len(order):
        grid.add_row("", _text(f"and {len(order) - len(shown)} more", _LABEL))
    for _ in range(rows - grid.row_count):
        grid.add_row("")
    return grid


def _natural(name: str) -> tuple[str, int, str]:
    """Sorts actor-10 after actor-9."""
    stem = name.rstrip("0123456789")
    return stem, int(name[len(stem) :] or 0), name


def _gates(gates: Sequence[Gate]) -> Table:
    grid = _grid(Column(width=1), Column(ratio=1), Column(justify="right"), Column(justify="right"))
    marks = {True: ("✓", _GOOD), False: ("✗", _BAD), None: ("·", _LABEL)}
    for gate in gates:
        mark, style = marks[gate.passed]
        grid.add_row(
            Text(mark, style),
            _text(gate.name, style if gate.passed is False else ""),
            _text(figures.significant(gate.value, 3), style),
            _text(gate.bound, _LABEL),
        )
    return grid


def _events(status: Status, rows: int) -> Table:
    """Why gates are red, then the newest notes that still have room, oldest of these first."""
    alerts = [(f"✗ {gate.name}: {gate.why}", _BAD) for gate in status.failed_gates]
    kept = alerts[: rows - 1] if status.notes else alerts[:rows]
    notes = status.notes[-(rows - len(kept)) :] if len(kept) < rows else ()
    grid = _grid(Column(ratio=1))
    for text, style in [*kept, *((note, _LABEL) for note in notes)]:
        grid.add_row(_text(text, style))
    return grid
