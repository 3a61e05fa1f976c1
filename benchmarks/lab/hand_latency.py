"""`python -m benchmarks.lab.hand_latency policies/ale_pong.safetensors`: the cost of latency.

Each network plays whole games with a modelled hand of several latencies. As with a robot, a new
command's keys are pressed late, while the old command's are released at once. Nothing is learned,
so compare networks that were trained at different latencies. `python -m benchmarks.figures.plot
--figure latency` draws the table.
"""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from annotated_types import MinLen

from benchmarks.lab.policy import evaluate
from benchmarks.report import BenchmarkOptions, Report, main, scored
from common.atomic_file import check_new_file
from common.checked import Fraction, FromOne
from common.press_latency import ms_of
from common.run.origin import run_of, trained_settings
from common.settings.conditions import Latency
from learner.evaluation.options import EPSILON

COLUMNS = (
    "network", "press", "late_ms", "games", "epsilon", "seed", "mean", "deviation",
    "iqm", "iqm_low", "iqm_high", "cpu", "git_commit", "git_dirty",
)  # fmt: skip
"""Columns of the table. ``press``: frames of 60 Hz that the game plays without a new command's
keys."""


@dataclass(frozen=True)
class Options(BenchmarkOptions):
    """Play games by trained networks with modelled hands of several latencies."""

    networks: tyro.conf.Positional[Annotated[tuple[Path, ...], MinLen(1)]]
    """Networks: published policies, or checkpoints in their runs' folders."""
    press: Annotated[tuple[Latency, ...], MinLen(1)] = (0, 1, 2, 3, 4, 6, 8)
    """Latencies of the hand to play at: emulator frames until a new command's keys are down."""
    games: FromOne = 10
    """Number of games for each network and latency."""
    epsilon: Fraction = EPSILON
    """Share of random agent steps."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("hand_latency.csv")
    """Table to write."""

    def check(self) -> None:
        super().check()
        check_new_file(self.output)


def run_or_policy(network: Path) -> str:
    """Returns the name of a published policy, such as ``ale_pong``, or of a checkpoint's run."""
    run = run_of(network)
    return run.name if run else network.stem


def hand_flags(network: Path, press: int) -> list[str]:
    """Returns the flags that make a modelled hand press the keys, even those of a robot.

    Raises:
        InputError: the settings of the network's training are unknown.
    """
    late = ["--play.press-latency", f"{press}"]
    return [*late, "--play.hand", "model"] if trained_settings(network).env == "robot" else late


def play(network: Path, press: int, options: Options) -> dict[str, Any]:
    told = evaluate(network, options.games, options.epsilon, hand_flags(network, press))
    told |= {
        "network": run_or_policy(network),
        "press": press,
        "late_ms": ms_of(press),
        "cpu": told["machine"]["cpu"],
    }
    return {name: told[name] for name in COLUMNS}


def measure(options: Options) -> Report:
    rows: list[dict[str, Any]] = []
    for press in options.press:
        for network in options.networks:
            rows.append(play(network, press, options))
            with options.output.open("w", newline="") as file:  # one that is stopped leaves these
                writer = csv.DictWriter(file, COLUMNS)
                writer.writeheader()
                writer.writerows(rows)
    shown = [
        {name: row[name] for name in ("network", "late_ms")} | {"games": scored(row)}
        for row in rows
    ]
    return Report.of("the cost of latency", shown, {}, f"every column is in {options.output}")


if __name__ == "__main__":
    main("lab.hand_latency", Options, measure)
