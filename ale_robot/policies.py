"""`ale-robot policies`: lists the shipped policies, by the cards beside their networks."""

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

from rich import box
from rich.console import Console
from rich.table import Column, Table

from common.minus import minus_signed
from common.run.origin import SHIPPED

_LEGEND = """\

ε: mean score with that share of random actions
sticky: mean score if the console repeats the last action with that probability
25 worlds: mean/worst of worlds with other latencies, light, poses and pictures
vector: commands and keys, of some joints too, beside the frames

Watch one: ale-robot watch NAME"""


_WIDTH = 80
"""Columns that the table needs."""


def list_policies() -> None:
    """Prints the policies that are shipped with the program, and their scores."""
    cards = {path.stem: json.loads(path.read_bytes()) for path in sorted(SHIPPED.glob("*.json"))}
    scores: dict[str, dict[str, str]] = {
        name: {_chance(row): _score(row["mean"]) for row in evaluation_rows(card)}
        for name, card in cards.items()
    }
    for name, card in cards.items():
        if (grid := GridScores.of(card)) is not None:
            mean, worst = (minus_signed(f"{each:.1f}") for each in (grid.mean, grid.worst))
            scores[name][f"{grid.worlds} worlds"] = f"{mean}/{worst}"
    chances = list(dict.fromkeys(chance for row in scores.values() for chance in row))
    # Headings of two lines leave room for long names at 80 columns.
    columns = [Column(each.replace(" ", "\n"), justify="right") for each in chances]
    texts = (Column(each, no_wrap=True) for each in ("policy", "game", "env", "input"))
    table = Table(*texts, *columns, box=box.SIMPLE, padding=0, show_edge=False)
    for name, card in cards.items():
        config = card["config"]
        table.add_row(
            name,
            config["game"],
            config["env"],
            "vector" if config["play"]["vector"] else "frames",
            *(scores[name].get(chance, "") for chance in chances),
        )
    console = Console(highlight=False)
    # In a narrower terminal lines go on below: no figure is cut.
    Console(highlight=False, width=max(console.width, _WIDTH)).print(table)
    console.print(_LEGEND, markup=False)


class GridScores(NamedTuple):
    """The scores of a policy in a grid of other worlds (`benchmarks.lab.robustness`), from its
    card."""

    worlds: int
    games: int
    """Games in each world."""
    mean: float
    """Mean of the worlds' mean scores."""
    worst: float
    """Least of the worlds' mean scores."""
    added_ms: float
    """Longest latency that is added to the hands, ms."""

    @classmethod
    def of(cls, card: Mapping[str, Any]) -> "GridScores | None":
        """Returns the grid in a card; None if it has none."""
        return cls(**card["grid"]) if "grid" in card else None


def evaluation_rows(card: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Returns the evaluations in a card: three, or one in a card of a former version; none if
    publishing was interrupted."""
    if (found := card.get("evaluation")) is None:
        return []
    return [{"sticky": 0.0} | row for row in found.get("rows", [found])]


def _score(mean: float) -> str:
    """Returns a mean score as text, with hundredths unless it is large."""
    return minus_signed(f"{mean:.2f}" if abs(mean) < 100 else f"{mean:,.0f}")


def _chance(row: dict[str, Any]) -> str:
    """Returns the heading of an evaluation's row: what was random in it."""
    return f"sticky {row['sticky']:g}" if row["sticky"] else f"ε {row['epsilon']:g}"
