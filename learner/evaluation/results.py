"""The results of an evaluation: a mapping of figures, and the table that shows them."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from itertools import chain
from typing import Any

from rich.markup import escape
from rich.table import Table

from common.minus import points
from common.press_latency import KeyLatency
from common.settings.clock import ClockConfig
from learner.evaluation.scores import Scores
from learner.telemetry.formats import decimal, per_cent, written

ENDING = 800
"""Agent steps at the end of a game, 53 s of play: games are compared by them, and as a whole."""


def summarise(games: Sequence[Mapping[str, Any]], clock: ClockConfig) -> dict[str, Any]:
    """Returns the figures of at least one game, as in the JSON of an evaluation.

    Args:
        games: what `actors.games` printed for each game.
        clock: how time passed.
    """

    def total(name: str) -> Any:
        return sum(game[name] for game in games)

    steps, decisions = total("steps"), total("decisions")
    endings = Counter(game["ending_hash"] for game in games)
    key_times = tuple(map(sum, zip(*(game["key_times"] for game in games), strict=True)))
    return {
        **asdict(Scores.of([game["score"] for game in games])),
        "distinct_games": len({game["game_hash"] for game in games}),
        "ending_steps": ENDING,
        "distinct_endings": len(endings),
        "same_ending": max(endings.values()),
        "steps": steps,
        "decisions": decisions,
        "game_seconds": total("game_seconds"),
        "wall_seconds": total("wall_seconds"),
        "game_per_wall": total("game_seconds") / total("wall_seconds"),
        "speed": None if clock.sync else clock.speed,
        "deadlines_kept_share": None if clock.sync else 1 - total("missed_deadlines") / decisions,
        "late_frames": total("late_frames"),
        "press_ms": asdict(KeyLatency.of(key_times, "press")),
        "release_ms": asdict(KeyLatency.of(key_times, "release")),
        "press_match_share": total("matched") / steps,
        "valid_frame_share": total("valid") / steps,
        "following_frame_share": total("follows") / steps,
        "scores": [game["score"] for game in games],
        "steps_of_games": [game["steps"] for game in games],
        "game_hashes": [game["game_hash"] for game in games],
        "ending_hashes": [game["ending_hash"] for game in games],
    }


def table(content: Mapping[str, Any]) -> Table:
    """Returns the table for people: a line for each figure, a column for each measurement."""
    rows = content.get("rows", [content])
    shown = Table(title=escape(content["weights"]), title_justify="left", show_header=False)
    trained = [row["changed"] for row in rows]
    # Only the conditions of its training, such as sticky actions; the others are listed above.
    usual = [
        [each for each in row["conditions"] if each not in changed]
        for row, changed in zip(rows, trained, strict=True)
    ]
    for name, columns in (("other than trained", trained), ("other than the preset", usual)):
        for change in dict.fromkeys(chain.from_iterable(columns)):
            cell = escape(change)  # the texts of settings may hold brackets
            shown.add_row(name, *(cell if change in column else "" for column in columns))
    for name, cell_of in _LINES:
        cells = [cell_of(row) for row in rows]
        if any(cells):
            shown.add_row(name, *cells)
    if len(rows) == 1:
        shown.add_row("every game", " ".join(map(points, rows[0]["scores"])))
    return shown


def _hands(row: Mapping[str, Any]) -> str:
    """Returns p50 and p99 of the time from a command to its keys, for release and press."""
    release, press = (KeyLatency(**row[name]) for name in ("release_ms", "press_ms"))
    return ", ".join(
        f"{name} {written('ms', found.p50)}/{written('ms', found.p99)}"
        for name, found in (("release", release), ("press", press))
        if release.measured + press.measured
    )


def _of_robot(row: Mapping[str, Any], share: str) -> str:
    """Returns a share of a robot's steps; nothing without a robot, where both are 1."""
    both = row["press_match_share"], row["valid_frame_share"]
    return per_cent(row[share], 1) if _hands(row) or min(both) < 1 else ""


def _keys(row: Mapping[str, Any]) -> str:
    share = _of_robot(row, "press_match_share")
    return share if row["keys_can_follow"] or not share else f"{share} (hands are late)"


def _mean(row: Mapping[str, Any]) -> str:
    """Returns the mean score, with its deviation if there are several games."""
    spread = f" ± {row['deviation']:.2f}" if row["games"] > 1 else ""
    return f"{decimal(row['mean'], 2)}{spread}"


def _steps(row: Mapping[str, Any]) -> str:
    """Returns the number of agent steps, and how many passed in the game if that is another."""
    passed = f" ({row['decisions']:,} passed)" if row["decisions"] != row["steps"] else ""
    return f"{row['steps']:,}{passed}"


def _pace(row: Mapping[str, Any]) -> str:
    if row["speed"] is None:
        return "not in real time"
    return "real time" if row["speed"] == 1 else f"real time × {row['speed']:g}"


_LINES: tuple[tuple[str, Callable[[Mapping[str, Any]], str]], ...] = (
    ("random actions ε", lambda row: f"{row['epsilon']:g}"),
    ("sticky actions", lambda row: f"{row['sticky']:g}"),
    ("games", lambda row: f"{row['games']}"),
    ("distinct games", lambda row: f"{row['distinct_games']}"),
    (
        f"alike in their last {ENDING} steps",
        lambda row: "none" if row["same_ending"] == 1 else f"{row['same_ending']}",
    ),
    ("mean ± deviation", _mean),
    ("interquartile mean", lambda row: decimal(row["iqm"], 2)),
    (
        "its 95 % interval",
        lambda row: (
            f"{decimal(row['iqm_low'], 2)} to {decimal(row['iqm_high'], 2)}"
            if row["games"] > 1
            else ""
        ),
    ),
    ("median", lambda row: points(row["median"])),
    ("least, most", lambda row: f"{points(row['least'])}, {points(row['most'])}"),
    ("agent steps", _steps),
    ("keys as commanded", _keys),
    ("command to keys, p50/p99 ms", _hands),
    ("frames valid", lambda row: _of_robot(row, "valid_frame_share")),
    ("time", _pace),
    ("game ÷ wall seconds", lambda row: f"{row['game_per_wall']:.2f}"),
    (
        "deadlines kept",
        lambda row: "" if row["speed"] is None else per_cent(row["deadlines_kept_share"], 2),
    ),
    ("late frames", lambda row: "" if row["speed"] is None else f"{row['late_frames']:,}"),
)
"""Names of the figures, and how each cell is written."""
