"""`ale-robot policies`: what is shipped, by the cards beside the networks."""

import json
import threading
from dataclasses import dataclass
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from common.run.origin import SHIPPED


@dataclass(frozen=True)
class Policies:
    """List the trained policies that come with the program, and their scores."""

    def run(self, stop: threading.Event) -> int:
        """Returns the exit status."""
        table = Table(
            "policy",
            "plays",
            "input",
            "mean score",
            "games",
            "agent steps",
            box=box.SIMPLE,
            padding=(0, 1, 0, 0),
        )
        for card in sorted(SHIPPED.glob("*.json")):
            told = json.loads(card.read_bytes())
            config = told["config"]
            first: dict[str, Any] = told["evaluation"].get("rows", [told["evaluation"]])[0]
            table.add_row(
                card.stem,
                f"{config['game']} ({config['env']})",
                "frames, vector" if config["play"]["vector"] else "frames",
                f"{first['mean']:.2f} ± {first['deviation']:.2f}",
                f"{first['games']}",
                f"{told['agent_steps']:,}",
            )
        Console().print(table)
        return 0
