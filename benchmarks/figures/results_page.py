"""`python -m benchmarks.figures.results_page`: writes the tables of RESULTS.md from result files.

The page's text is written by hand. Between a marker and ``<!-- end -->`` stands a table made from
files in ``benchmarks/results``, so that no figure is copied by hand:

* ``<!-- NAME.json -->``: the table of ``NAME.json``. For a file ``race*.json`` it has a row for
  each run.
* ``<!-- NAME.json kinds -->``: one of several tables of a file, by its name, here ``kinds``.
* ``<!-- ladder.csv -->``: what was learned, rung by rung.
* ``<!-- ladder-*-pong-*.csv -->``: how fast each run learned, from all files with such names.
* ``<!-- not reproducible -->``: the results that their commit alone does not reproduce.
* ``<!-- needs of robots -->``: what `benchmarks.figures.needs` computes from several results.
"""

import csv
import io
import json
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.figures.commits import Source, sources
from benchmarks.figures.needs import NAMES, ROBOTS, SOURCES, needs
from benchmarks.lab.ladder import MILESTONES
from benchmarks.report import cell, scored
from common.command_line.parser import parse
from common.errors import InputError
from common.process.program_end import exit_on_input_error
from common.run.epochs import EpochRow, EpochTable
from learner.telemetry.provenance import machine_line

PAGE = Path(__file__).resolve().parents[1] / "RESULTS.md"
CURVE = (100_000, 200_000, 250_000, 300_000, 400_000, 500_000, 600_000, 800_000, 1_000_000)
"""Agent steps at which the table gives the score of a run's training games."""
_CLOSE = 25_000
"""Steps from which on the end of an epoch is too far from one of these."""
_TABLE = re.compile(
    r"<!-- (?P<name>[\w*-]+\.(?:json|csv)|not reproducible|needs of robots)"
    r"(?: (?P<rows>\w+))? -->\n(?:.*?\n)??<!-- end -->",
    re.DOTALL,
)


def render(page: str, folder: Path) -> str:
    """Returns ``page`` with the tables of the files in ``folder``.

    Raises:
        InputError: a file that the page names does not exist.
    """

    def table(found: re.Match[str]) -> str:
        mark = " ".join(filter(None, found.group("name", "rows")))
        return f"<!-- {mark} -->\n{body(found['name'], found['rows'])}\n<!-- end -->"

    def body(name: str, rows: str | None) -> str:
        if name == "not reproducible":
            return not_reproducible(sources(folder))
        if name == "needs of robots":
            return needed(folder)
        if "*" in name:
            return curves(sorted(folder.glob(name)))
        file = folder / name
        if not file.exists():
            raise InputError(f"{file} does not exist: run the benchmark that makes it with --json.")
        text = file.read_text(encoding="utf-8")
        if file.suffix == ".csv":
            return learned(csv.DictReader(io.StringIO(text)))
        if name.startswith("race"):
            return raced(json.loads(text))
        return markdown(json.loads(text), rows)

    return _TABLE.sub(table, page)


def markdown(measurement: Mapping[str, Any], which: str | None = None) -> str:
    """Returns a measurement that `benchmarks.report` wrote as a table, above machine and commit.

    ``which`` names one of its further tables; the main one (None) has a title.
    """
    rows = measurement[which or "rows"]
    names = list(rows[0])
    aligned = ["---" if isinstance(rows[0][name], str) else "---:" for name in names]
    cells = [[cell(row[name]) for name in names] for row in rows]
    table = _table(names, aligned, cells, "", _where(measurement))
    return table if which else f"{measurement['title']}\n\n{table}"


def _first(reached: Mapping[str, Any] | None) -> str:
    """Returns the minutes and the thousands of agent steps after which something was reached."""
    if reached is None:
        return "–"
    return f"{reached['seconds'] / 60:.1f} ({reached['agent_steps'] / 1000:.0f}K)"


def raced(race: Mapping[str, Any]) -> str:
    """Returns a table of the runs of a race that `benchmarks.lab.race` wrote.

    It has each run's duration, when its training games and its tests first had each score, and the
    scores of its last weights.
    """
    scores = list(race["runs"][0]["training"])
    names = ["seed", "agent steps", "minutes", "steps/s", *(f"≥ {score}" for score in scores)]
    names += [
        f"tests ≥ {', '.join(scores)}",
        *(
            f"ε = {row['epsilon']:g}" + (f", sticky {row['sticky']:g}" if row["sticky"] else "")
            for row in race["runs"][0]["headline"]
        ),
    ]
    cells = [
        [
            f"{run['seed']}",
            f"{run['agent_steps']:,}",
            f"{run['wall_seconds'] / 60:.1f}",
            f"{run['steps_per_second']:.0f}",
            *(_first(run["training"][score]) for score in scores),
            ", ".join(_first(run["test"][score]) for score in scores),
            *(scored(row, 2) for row in run["headline"]),
        ]
        for run in race["runs"]
    ]
    return _table(names, ["---:"] * len(names), cells, "", _where(race))


def _where(measurement: Mapping[str, Any]) -> str:
    """Returns the machine and the commit of a measurement, as a sentence."""
    torch = measurement["versions"].get("torch")  # not known of a checkout that is not installed
    commit = commit_of(measurement["git_commit"], measurement.get("git_dirty"))
    parts = [machine_line(measurement["machine"]), torch and f"torch {torch}", f"commit {commit}"]
    return f"{', '.join(filter(None, parts))}."


def commit_of(commit: str | None, dirty: bool | None) -> str:
    """Returns ``commit`` shortened, with a + if tracked files differed from it."""
    return f"{commit[:7]}{'+' if dirty else ''}" if commit else "?"


def learned(rows: Iterable[Mapping[str, str]]) -> str:
    """Returns a table of rows of `benchmarks.lab.ladder`: what was reached, and when."""
    names = ["rung", "game", "seed", "random", "score of a game", "IQM (95 %)"]
    names += [f"≥ {score:g}" for score in MILESTONES.values()]
    names += ["steps", "hours", "commit"]
    cells = [
        [
            ", ".join(filter(None, (row["rung"], row["label"]))),
            row["game"],
            row["seed"],
            f"{float(row['random_reward']):.1f}" if row["random_reward"] else "–",
            f"{float(row['mean']):.2f} ± {float(row['deviation']):.2f}",
            "{:.2f} ({:.2f} to {:.2f})".format(
                *(float(row[name]) for name in ("iqm", "iqm_low", "iqm_high"))
            ),
            *(_thousands(row[f"steps_to_{name}"]) for name in MILESTONES),
            _thousands(row["agent_steps"]),
            f"{float(row['wall_seconds']) / 3600:.1f}",
            commit_of(row["git_commit"], row["git_dirty"] == "True"),
        ]
        for row in sorted(rows, key=lambda row: (row["rung"], row["label"], int(row["seed"])))
    ]
    return _table(names, ["---"] * 2 + ["---:"] * (len(names) - 3) + ["---"], cells)


def not_reproducible(found: Iterable[Source]) -> str:
    """Returns the results that their commit and flags alone do not reproduce, and why."""
    reasons: dict[tuple[str, str, str], list[str]] = {}
    for each in found:
        if each.dirty is not False or each.note:
            differed = "unknown whether tracked files differed" if each.dirty is None else ""
            differed = "tracked files differed" if each.dirty else differed
            reason = "; ".join(filter(None, (each.note, differed)))
            key = (each.file, commit_of(each.commit, each.dirty), reason)
            reasons.setdefault(key, []).append(each.part)
    cells = [
        [file, "; ".join(dict.fromkeys(filter(None, parts))) or "all", commit, reason]
        for (file, commit, reason), parts in reasons.items()
    ]
    return _table(["file", "results", "commit", "what differs"], ["---"] * 4, cells)


def needed(folder: Path) -> str:
    """Returns what more and more robots need, above the sources of the results behind it."""
    aligned = ["---", *["---:"] * len(ROBOTS), "---", "---"]
    measured = (
        f"{name}.json: {_where(json.loads((folder / f'{name}.json').read_bytes()))}"
        for name in SOURCES
    )
    return _table(NAMES, aligned, list(needs(folder)), "", *measured)


def curves(files: Iterable[Path]) -> str:
    """Returns the mean score of each run's training games around the steps of `CURVE`."""
    cells = []
    for file in files:
        trained = [row for row in EpochTable(file).rows() if row.phase == "train"]
        means = (_mean_near(steps, trained) for steps in CURVE)
        told = ("–" if mean is None else f"{mean:.1f}" for mean in means)
        cells.append([file.stem.removeprefix("ladder-"), *told])
    names = ["run", *(_thousands(f"{steps}") for steps in CURVE)]
    return _table(names, ["---"] + ["---:"] * len(CURVE), cells)


def _mean_near(steps: int, rows: Sequence[EpochRow]) -> float | None:
    gap, mean = min(
        ((abs(row.total_train_steps - steps), row.average_reward) for row in rows),
        key=lambda found: found[0],
        default=(_CLOSE, None),
    )
    return mean if gap < _CLOSE else None


def _thousands(steps: str) -> str:
    return f"{round(float(steps) / 1000):,}K" if steps else "–"


def _table(
    names: Sequence[str], aligned: Sequence[str], cells: Sequence[Sequence[str]], *below: str
) -> str:
    rows = (f"| {' | '.join(line)} |" for line in (names, aligned, *cells))
    return "\n".join((*rows, *below))


@dataclass(frozen=True)
class Options:
    """Write the tables of benchmarks/RESULTS.md anew, from the files in benchmarks/results."""


def main() -> None:
    parse(Options, "benchmarks.figures.results_page", sys.argv[1:])
    PAGE.write_text(render(PAGE.read_text(), PAGE.parent / "results"))
    print(f"wrote {PAGE}")


if __name__ == "__main__":
    exit_on_input_error(main)
