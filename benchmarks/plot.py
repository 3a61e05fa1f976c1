"""`python -m benchmarks.plot runs/A runs/B -o figure.png`: the report's Figures 6 to 9.

Left the mean score of each epoch, with the random policy as a red line; right the mean max-Q over
the held-out states.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import tyro

from common.errors import InputError, exit_on_input_error
from learner.epochs import EpochRow, EpochTable


@dataclass(frozen=True)
class Options:
    """Draw the curves of runs, or of tables in the format of 2017."""

    runs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of runs, or CSV files."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("figure.png")
    """Picture to write: .png, .svg or .pdf."""


def read(path: Path) -> list[EpochRow]:
    """The rows of a run's folder or CSV file.

    Raises:
        InputError: there are none.
    """
    rows = EpochTable(path if path.suffix == ".csv" else path / "epochs.csv").rows()
    if not rows:
        raise InputError(f"there is no epoch in {path}: let the run finish one first.")
    return rows


def draw(runs: dict[str, list[EpochRow]], output: Path) -> None:
    """Write the figure of ``runs`` (name → rows) to ``output``."""
    figure, (scores, values) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for index, (name, rows) in enumerate(runs.items()):
        colour = f"C{index}"
        for phase, style in (("test", "-o"), ("train", ":")):
            points = [
                (row.total_train_steps / 1e3, row.average_reward)
                for row in rows
                if row.phase == phase and row.average_reward is not None
            ]
            scores.plot(
                *zip(*points, strict=True) if points else ((), ()),
                style,
                color=colour,
                markersize=4,
                label=f"{name}, {phase}",
            )
        measured = [
            (row.total_train_steps / 1e3, row.meanq)
            for row in rows
            if row.phase != "test" and row.meanq is not None
        ]
        values.plot(*zip(*measured, strict=True), "-o", color=colour, markersize=4, label=name)
    random = [row.average_reward for rows in runs.values() for row in rows if row.phase == "random"]
    if random and random[0] is not None:
        scores.axhline(random[0], color="red", linewidth=1, label="random policy")
    scores.set(xlabel="agent steps of training (thousands)", ylabel="mean score of a game")
    values.set(
        xlabel="agent steps of training (thousands)", ylabel="mean max-Q over held-out states"
    )
    for axes in (scores, values):
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    scores.legend(frameon=False, fontsize=8)
    figure.savefig(output, dpi=110)
    plt.close(figure)


def main() -> int:
    options = tyro.cli(Options, prog="python -m benchmarks.plot")
    draw({path.stem: read(path) for path in options.runs}, options.output)
    print(f"wrote {options.output}")
    return 0


if __name__ == "__main__":
    exit_on_input_error(main)
