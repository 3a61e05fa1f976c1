"""The one screen of a run: its figures, laid out for the terminal's size.

Everything important fits 80 × 24. A larger terminal shows more figures, actors and events, and then
a taller chart. A narrower one has the same figures down to 60 columns, in two panels side by side,
and lists health checks if lines are left. A lower one lists fewer actors and health checks, so that
red ones and their reasons stay. Nothing wraps, so the number of lines is known before they are
drawn.
"""

from collections.abc import Iterable, Mapping, Sequence

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.progress_bar import ProgressBar
from rich.rule import Rule
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

from common.metrics import Metric, Values, number
from common.protocol.actor_stats import TOTALS
from common.protocol.run_status import HealthCheck
from common.registry import ENVIRONMENTS
from learner.telemetry import formats
from learner.telemetry.formats import figure
from learner.telemetry.panels import label_and_text, panels_of, progress_of, troubles
from learner.telemetry.sinks.charts import bars, columns_of
from learner.telemetry.sinks.live_picture import LivePicture
from learner.telemetry.snapshot import ActorView, Snapshot

_WIDEST = 200
_ECHO = 2
"""Columns left free: a terminal writes ^C behind the last line, which must not wrap."""
_ACCENT, _GOOD, _BAD, _LABEL, _LINE = "cyan", "green", "bold red", "dim", "dim"
_ROOMY = 108
"""Minimum number of columns for more details about actors."""

_LEAST, _GAP = 80, 3
"""Minimum number of columns of the figures beside a picture, and columns between the two."""
_NARROW = _LEAST - _ECHO
"""Number of columns below which three panels have no room side by side."""
_MACHINES = 124
"""Minimum number of columns for the actors' use of their machines."""
_ROWS = 23
"""Lines at 80 × 24; one line is left for the cursor."""
_FIGURES = 6
"""Lines for the figures of a panel."""
_LIST_ROWS = 7
"""Lines for actors, and for health checks beside them."""
_LARGE = 35
"""Minimum number of lines for the large layout: gaps, two more figures in each panel, and a chart
of five lines. Further lines first go to figures that had no room."""


class Screen:
    """A renderable of ``snapshot`` that has at least one line less than the console."""

    def __init__(self, snapshot: Snapshot, picture: LivePicture | None = None) -> None:
        self._snapshot = snapshot
        self._picture = picture

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        width, rows = min(options.max_width - _ECHO, _WIDEST), max(console.size.height - 1, 1)
        parts: RenderableType
        picture = picture_width(*console.size) if self._picture is not None else 0
        if picture:
            left = width - picture - _GAP
            beside = _grid(Column(width=left), Column(width=picture), gap=_GAP)
            beside.add_row(Group(*_parts(self._snapshot, left, rows)), self._picture)
            parts = beside
        elif width < _NARROW:
            parts = Group(*_parts_in_pairs(self._snapshot, width, rows))
        else:
            parts = Group(*_parts(self._snapshot, width, rows))
        lines = console.render_lines(parts, options.update(width=width), pad=False)
        for at, line in enumerate(lines[:rows]):
            if at:
                yield Segment.line()
            yield from line


def picture_width(columns: int, rows: int) -> int:
    """Returns the width of the actor's picture beside the figures, in a terminal of that size; 0 if
    there is no room."""
    spare = min(columns - _ECHO, _WIDEST) - _GAP
    least = LivePicture.LEAST_WIDTH
    if spare < _LEAST + least or rows <= LivePicture.height(least):
        return 0
    widths = range(spare - _MACHINES, least, -1)
    return next((width for width in widths if LivePicture.height(width) < rows), least)


def _parts(snapshot: Snapshot, width: int, rows: int) -> Iterable[RenderableType]:
    large = rows >= _LARGE
    spare = rows - (_LARGE if large else _ROWS)
    short, spare = min(spare, 0), max(spare, 0)
    panels = panels_of(snapshot.values)
    figures = _FIGURES
    if large:
        figures = min(max(8, *map(len, panels.values())), 8 + spare)
        spare -= figures - 8
    wanted = max(len(snapshot.present), len(snapshot.checks)) - _LIST_ROWS
    more_rows = min(max(wanted, 0), spare)
    taller = (spare - more_rows) * 2 // 3 if large else 0
    gap = [Text()] if large else []
    # The page's address takes the place of an empty line.
    page = _page(snapshot.values)
    yield _header(snapshot.values, width)
    yield from [page] if large else []
    yield _progress(snapshot.values, width)
    yield from gap
    yield _beside(*_figures(panels, snapshot.values, figures))
    yield from gap
    yield from _history(snapshot, width, 5 + taller if large else 1)
    yield Text() if large else page
    listed = max(_LIST_ROWS + more_rows + short, 1)
    yield _beside(_actors(snapshot, listed, width), _checks(snapshot, listed), last_width=40)
    if large:
        yield Text()
        yield _title("Events")
    yield _events(snapshot, 2 + spare - more_rows - taller)


def _parts_in_pairs(snapshot: Snapshot, width: int, rows: int) -> Iterable[RenderableType]:
    short, spare = min(rows - _ROWS, 0), max(rows - _ROWS, 0)
    listed = max(_FIGURES + short, 1)
    checks = min(len(snapshot.checks), spare)
    more_actors = min(max(len(snapshot.present) - _FIGURES, 0), spare - checks)
    *panels, last = panels_of(snapshot.values).items()
    yield _header(snapshot.values, width)
    yield _progress(snapshot.values, width)
    yield _beside(*_figures(dict(panels), snapshot.values, _FIGURES))
    yield from _history(snapshot, width, 1)
    yield _page(snapshot.values)
    beside_actors = _panel(*last, snapshot.values, listed)
    yield _beside(beside_actors, _actors(snapshot, listed + more_actors, width))
    yield _checks(snapshot, checks)
    yield _events(snapshot, 2 + spare - checks - more_actors)


def _beside(*parts: RenderableType, last_width: int | None = None) -> Table:
    columns = [Column(ratio=1) for _ in parts]
    if last_width is not None:
        columns[-1] = Column(width=last_width)
    grid = _grid(*columns, gap=3)
    grid.add_row(*parts)
    return grid


def _text(text: str, style: str = "", *, end: str = "") -> Text:
    """Returns a cell of a table; with ``end``, a line."""
    return Text(formats.one_line(text), style, no_wrap=True, overflow="ellipsis", end=end)


def _title(text: str) -> Rule:
    return Rule(Text(text, "bold"), align="left", style=_LINE)


def _grid(*columns: Column, gap: int = 1) -> Table:
    for column in columns:
        column.no_wrap, column.overflow = True, "ellipsis"
    return Table.grid(*columns, expand=True, padding=(0, gap, 0, 0))


def _header(values: Values, width: int) -> Table:
    env = ENVIRONMENTS.find(str(values["run/env"]))
    title = Text(env.title or env.name, f"bold {_ACCENT}")
    if game := formats.game_of(values):
        title.append(f"  {game}", "bold default")
    title.append(f"  run {values['run/run']}", "default")
    grid = _grid(Column(ratio=1), Column(justify="right"))
    device = formats.hardware(values) if width >= _ROOMY else values["run/device"]
    where = "" if width < _NARROW else f" · {device}"
    grid.add_row(title, _text(f"{values['run/preset']} preset{where}", _LABEL))
    return grid


def _page(values: Values) -> Text:
    """Returns the line with the address of the run's page; empty without a page."""
    page = values.get("run/page")
    return Text() if page is None else _text(f"watch the run at {page}", _ACCENT, end="\n")


def _progress(values: Values, width: int) -> Table:
    narrow = width < _NARROW
    columns = [
        Column(min_width=9, ratio=1 if narrow else None),
        Column(justify="right", min_width=5),
        Column(justify="right", min_width=None if narrow else 12),
        Column(justify="left"),
        Column(justify="right", min_width=14),
    ]
    if not narrow:
        columns.insert(1, Column(ratio=1))
    grid = _grid(*columns)
    for label, done, total, note in progress_of(values):
        now, goal = number(values, done) or 0, number(values, total)
        bar: RenderableType = _text("until stopped", _LABEL)
        share, end = "", "steps"
        if goal is not None:
            bar = ProgressBar(
                max(goal, 1), min(now, goal), complete_style=_ACCENT, finished_style=_ACCENT
            )
            share = formats.share(now, goal)
            end = f"of {figure(total, values)}{'' if narrow else ' steps'}"
        cells: list[RenderableType] = [
            share,
            figure(done, values),
            _text(end, _LABEL),
            _text(note, _LABEL),
        ]
        grid.add_row(_text(label, "bold"), *([] if narrow else [bar]), *cells)
    return grid


def _figures(panels: Mapping[str, Sequence[Metric]], values: Values, rows: int) -> list[Group]:
    """Returns the panels, with the first ``rows`` metrics of each."""
    return [_panel(*panel, values, rows) for panel in panels.items()]


def _panel(title: str, metrics: Sequence[Metric], values: Values, rows: int) -> Group:
    return Group(_title(title), *(_figure(metric, values) for metric in metrics[:rows]))


def _figure(metric: Metric, values: Values) -> Table:
    """Returns a figure's line. Without room for all of it the label is cut, because a number that
    is cut is another one."""
    label, text = label_and_text(metric, values)
    line = _grid(Column(ratio=1), Column(justify="right"))
    line.add_row(_text(label, _LABEL), _text(text))
    return line


def _history(snapshot: Snapshot, width: int, rows: int) -> Iterable[RenderableType]:
    """Yields the chart of rewards by epoch; those not above the random policy's are dim."""
    name = "Test" if snapshot.rewards.get("test") else "Train"
    values = snapshot.rewards.get(name.lower())
    random = number(snapshot.values, "play/random_reward")
    if rows > 1:
        yield _title(f"{name} reward by epoch")
    if not values:
        yield _text("no epoch is over yet", _LABEL, end="\n")
        yield from [Text()] * (rows - 1)
        return
    known = [*values, *([] if random is None else [random])]
    low, high = min(known), max(known)
    if rows > 1 and low == high:  # the axis needs a range
        low, high = low - 1, high + 1
    top, bottom = formats.decimal(high, 1), formats.decimal(low, 1)
    if rows == 1:
        labels = [f"{name.lower()} {bottom} … {top}"]
    else:
        labels = [top, *[""] * (rows - 2), bottom]
    margin = max(map(len, labels))
    heights = columns_of(values, width - margin - 2)
    floor = low if random is None else random
    for label, blocks in zip(labels, bars(heights, low, high, rows), strict=True):
        line = Text(no_wrap=True, overflow="crop")
        line.append(f"{label:>{margin}}  ", _LABEL)
        for block, value in zip(blocks, heights, strict=True):
            line.append(block, _ACCENT if value > floor else _LABEL)
        yield line


def _actors(snapshot: Snapshot, rows: int, width: int) -> Group:
    alive, present = (number(snapshot.values, f"stream/actors_{n}") for n in ("alive", "present"))
    wrong = troubles(snapshot.values)
    title = f"Actors {alive}/{present}{wrong}" if wrong else f"Actors, {alive} of {present} alive"
    actors = _list_of_actors(snapshot.present, rows, width, values=snapshot.values)
    for _ in range(rows - actors.row_count):
        actors.add_row("")
    return Group(_title(title), actors)


def _list_of_actors(actors: Sequence[ActorView], rows: int, width: int, values: Values) -> Table:
    roomy, machines = width >= _ROOMY, width >= _MACHINES
    if not actors:
        grid = _grid(Column(ratio=1))
        join = values.get("run/join")
        grid.add_row(_text(f"start one: {join}" if join else "none yet", _ACCENT))
        return grid
    right = [Column(justify="right") for _ in range(6 if machines else 5 if roomy else 2)]
    grid = _grid(Column(width=1), Column(ratio=1, min_width=8), *right, gap=2 if roomy else 1)
    # Lost actors come first, because there may be no room for the last ones.
    order = sorted(actors, key=lambda a: (a.alive, a.stats.role, len(a.stats.name), a.stats.name))
    shown = order if len(order) <= rows else order[: rows - 1]
    for actor in shown:
        stats = actor.stats
        style = "" if actor.alive else _LABEL if stats.leaving else _BAD
        rate = (
            f"{formats.decimal(stats.steps_per_second, 1)}/s"
            if actor.alive
            else formats.ended(stats.leaving)
        )
        cells = [_text(f"{stats.steps:,}"), _text(rate)]
        if roomy:
            wrong = troubles({key: getattr(stats, name) for name, key in TOTALS.items()})
            cells += [
                _text(f"ε {formats.decimal(stats.epsilon, 3)}"),
                _text(f"{stats.retried:,} retried{wrong}", _LABEL),
                _text(f"silent {actor.silent_for:.0f} s", _LABEL),
            ]
        if machines:
            cells.append(_text(formats.taken(stats.busy_cores, stats.memory_bytes), _LABEL))
        mark = Text("●", _GOOD) if actor.alive else Text("○", style)
        for cell in cells:
            cell.stylize(style)
        grid.add_row(mark, _text(stats.name, style), *cells)
    if len(shown) < len(order):
        grid.add_row("", _text(f"and {len(order) - len(shown)} more", _LABEL))
    return grid


def _checks(snapshot: Snapshot, rows: int) -> Group:
    checks: Sequence[HealthCheck] = snapshot.checks
    grid = _grid(Column(width=1), Column(ratio=1), Column(justify="right"), Column(justify="right"))
    marks = {True: ("✓", _GOOD), False: ("✗", _BAD), None: ("·", _LABEL)}
    if len(checks) > rows:
        checks = sorted(checks, key=lambda check: check.passed is not False)[:rows]
    for check in checks:
        mark, style = marks[check.passed]
        grid.add_row(
            Text(mark, style),
            _text(check.name, style if check.passed is False else ""),
            _text(formats.reading(check), style),
            _text(check.bound, _LABEL),
        )
    return Group(_title(f"Health checks, {snapshot.verdict}"), grid)


def _events(snapshot: Snapshot, rows: int) -> Table:
    """Returns the reasons of red checks, then the newest notes that have room, oldest first."""
    alerts = [(f"✗ {check.name}: {check.why}", _BAD) for check in snapshot.failed]
    kept = alerts[: rows - 1] if snapshot.notes else alerts[:rows]
    notes = snapshot.notes[-(rows - len(kept)) :] if len(kept) < rows else ()
    grid = _grid(Column(ratio=1))
    for text, style in [*kept, *((note, _LABEL) for note in notes)]:
        grid.add_row(_text(text, style))
    return grid
