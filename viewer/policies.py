"""`ale-robot policies`: what is shipped, by the cards beside the networks."""

import json
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from rich import box
from rich.console import Console
from rich.table import Column, Table

from common.minus import minus_signed
from common.run.origin import SHIPPED

_LEGEND = """\
 ε: mean score where that share of the actions is random
 sticky: where the console repeats the action before with that probability
 25 worlds: mean/worst of worlds with other latencies, light, poses and pictures
 vector: commands, keys and joints, beside the frames of camera or emulator

 Watch one: ale-robot watch NAME"""


@dataclass(frozen=True)
class Policies:
    """List the trained policies that come with the program, and their scores."""

    def run(self, stop: threading.Event) -> None:
        cards = {
            path.stem: json.loads(path.read_bytes()) for path in sorted(SHIPPED.glob("*.json"))
        }
        scores: dict[str, dict[str, str]] = {
            name: {_chance(row): _score(row["mean"]) for row in evaluation_rows(card)}
            for name, card in cards.items()
        }
        for name, card in cards.items():
            if (grid := Grid.of(card)) is not None:
                mean, worst = (minus_signed(f"{each:.1f}") for each in (grid.mean, grid.worst))
                scores[name][f"{grid.worlds} worlds"] = f"{mean}/{worst}"
        chances = list(dict.fromkeys(chance for row in scores.values() for chance in row))
        columns = [Column(each, justify="right") for each in chances]
        names = Column("policy", overflow="fold")
        table = Table(names, "plays", "input", *columns, box=box.SIMPLE, padding=0)
        for name, card in cards.items():
            config = card["config"]
            table.add_row(
                name,
                f"{config['game']} ({config['env']})",
                "vector" if config["play"]["vector"] else "frames",
                *(scores[name].get(chance, "") for chance in chances),
            )
        console = Console(highlight=False)
        console.print(table)
        console.print(_LEGEND, markup=False)


class Grid(NamedTuple):
    """How a policy plays in a grid of other worlds (`benchmarks.lab.robustness`), as its card has
    it."""

    worlds: int
    games: int
    """Games in each world."""
    mean: float
    """Mean of the worlds' mean scores."""
    worst: float
    """Least of them."""
    added_ms: float
    """Longest latency that is added to the hands, ms."""

    @classmethod
    def of(cls, card: Mapping[str, Any]) -> "Grid | None":
        """Returns what a card says; None if it says nothing."""
        return cls(**card["grid"]) if "grid" in card else None


def evaluation_rows(card: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Returns the evaluations in a card: three, or the one of a former version; none if its
    publishing was broken off."""
    if (found := card.get("evaluation")) is None:
        return []
    return [{"sticky": 0.0} | row for row in found.get("rows", [found])]


def _score(mean: float) -> str:
    """A mean score, to hundredths only where they tell something."""
    return minus_signed(f"{mean:.2f}" if abs(mean) < 100 else f"{mean:,.0f}")


def _chance(row: dict[str, Any]) -> str:
    """What was random in a row of an evaluation."""
    return f"sticky {row['sticky']:g}" if row["sticky"] else f"ε {row['epsilon']:g}"
