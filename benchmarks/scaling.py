"""`python -m benchmarks.scaling`: what more actors on this machine bring, and a figure of it.

Each number of actors is measured as by `benchmarks.epochs_per_day`.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from benchmarks.child import end_as_by_ctrl_c
from benchmarks.epochs_per_day import describe, measure, summary
from benchmarks.local_run import Setting
from benchmarks.report import publish
from common.errors import InputError, exit_on_input_error


@dataclass(frozen=True)
class Options:
    """Measure local mode with several numbers of actors."""

    setting: tyro.conf.OmitArgPrefixes[Setting]
    numbers: tuple[int, ...] = (1, 2, 4, 8)
    """Numbers of actors; --actors is not for here."""
    seconds: float = 10.0
    """Of each of the two windows for each number."""
    json: Path | None = None
    """File for the results."""
    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Figure to write: .png, .svg or .pdf."""

    def check(self) -> None:
        self.setting.check()
        if not self.numbers or min(self.numbers) < 1:
            raise InputError("--numbers: choose numbers of actors of 1 or more.")
        if not self.seconds > 0:
            raise InputError(f"--seconds is {self.seconds}: choose a number above 0.")
        if self.output is not None and self.output.suffix not in (".png", ".svg", ".pdf"):
            raise InputError(f"{self.output} should end in .png, .svg or .pdf.")


def row(found: Mapping[str, Any]) -> dict[str, Any]:
    """The measurement of one number of actors as a line of the table."""
    return {
        "actors": found["actors"],
        "train/s": found["train_steps_per_second"],
        "at test": found["train_steps_per_second_beside_test"],
        "test/s": found["test_steps_per_second_beside_training"],
        "samples": found["samples_per_insert"],
        "stale": found["staleness_updates"]["p50"],
        **({} if found["sync"] else {"in time": found["deadlines_kept"]}),
        "epochs": found["epochs_per_day"],
        "beside": found["epochs_per_day_overlapped"],
    }


def draw(measured: Sequence[Mapping[str, Any]], title: str, output: Path) -> None:
    """Write steps per second against actors to ``output``."""
    import matplotlib  # only who wants the figure needs it

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    actors = [each["actors"] for each in measured]
    figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    for name, label in (
        ("train_steps_per_second", "training, evaluator idle"),
        ("train_steps_per_second_beside_test", "training beside a test"),
        ("test_steps_per_second_beside_training", "that test"),
    ):
        axes.plot(actors, [each[name] for each in measured], "-o", markersize=4, label=label)
    axes.set_xticks(actors)
    axes.set_ylim(bottom=0)
    axes.set(xlabel="actors", ylabel="agent steps per second")
    axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8)
    figure.savefig(output, dpi=110)
    plt.close(figure)


def main() -> None:
    options = tyro.cli(Options, prog="python -m benchmarks.scaling")
    options.check()
    end_as_by_ctrl_c()
    measured = []
    for actors in options.numbers:
        setting = dataclasses.replace(options.setting, actors=actors)
        measured.append(summary(setting, measure(setting, options.seconds)))
        print(f"{actors}: {measured[-1]['train_steps_per_second']:.1f} steps/s", flush=True)
    what = describe(options.setting).rsplit(", ", 1)[0]
    publish(
        f"Local mode, {what}, batches of 32, an update per 4 steps (samples per insert; staleness "
        "in updates, p50; epochs a day with tests after training, and beside it)",
        [row(each) for each in measured],
        options.json,
        {"scaling": measured},
    )
    if options.output is not None:
        draw(measured, what, options.output)
        print(f"wrote {options.output}")


if __name__ == "__main__":
    exit_on_input_error(main)
