"""Figures that pages state in their text are those of the result files.

Tables of `benchmarks/RESULTS.md` are written by `benchmarks.figures.results_page`. What a page says
besides is written by hand: a sentence that ages when a benchmark is measured again is listed here,
made from the file.
"""

import json
import re
from collections import Counter
from collections.abc import Iterator
from typing import Any

import pytest

from benchmarks.figures.results_page import PAGE
from benchmarks.registry import BENCHMARKS, RESULTS
from tests.paths import ROOT

_MADE_ELSEWHERE = {
    "learner_updates_float32": "an AMD EPYC without bfloat16",
    "learner_updates_intel": "an Intel Xeon without AMX",
    "learner_updates_intel_128": "an Intel Xeon without AMX",
    "learner_updates_seeds": "losses by eight seeds, which learner_updates makes now",
}
"""Tables of speed that another machine made, or another hour."""


def result(name: str) -> Any:
    return json.loads((RESULTS / f"{name}.json").read_bytes())


def stated() -> Iterator[tuple[str, str]]:
    """Yields pages, and sentences that they hold."""
    steps, parts = result("env_steps"), result("env_steps")["breakdown_us"]
    for words, part in (
        ("physics, 16 steps", "physics"),
        ("emulator, 4 frames", "emulator"),
        ("rendering", "render"),
        ("screen detection and unwarping", "detection"),
        ("the rest", "rest"),
    ):
        yield "docs/results.md", f"| {words} | {parts[part]:.0f} |"
    robot, alone = steps["robot_sync"], steps["ale"]
    yield "docs/results.md", f"| {robot:.0f} (ALE-Only {alone:,.0f};"
    yield "docs/conditions.md", f"A step of the robot takes {1e-3 * sum(parts.values()):.1f} ms"
    whole = result("actor_steps")
    yield (
        "docs/results.md",
        f"| {whole['robot']['1']:.0f}; {whole['robot']['4']:.0f} with four robots in a process "
        f"(ALE-Only {whole['ale']['1']:,.0f} and {whole['ale']['4']:,.0f}) |",
    )

    zenoh, most = result("transport"), result("many_actors")["many_actors"][-1]
    at_once, paced = (
        tuple(_hundreds(zenoh[part]["transitions_per_second"]) for part in pair)
        for pair in (
            ("insert_at_once", "sample_at_once"),
            ("insert_paced", "sample_beside_paced"),
        )
    )
    yield "docs/operations.md", f"as fast as both can (`transport`) | {' | '.join(at_once)} |"
    yield "docs/operations.md", f"if {paced[0]} come per second | {' | '.join(paced)} |"
    uniform = result("transport_uniform")["sample_beside_paced"]["transitions_per_second"]
    yield "docs/operations.md", f"by priority | {paced[0]} | {_hundreds(uniform)} |"
    insert, sample = zenoh["insert"], zenoh["sample"]
    step, batch = (
        each["megabytes_per_second"] / each[rate]
        for each, rate in ((insert, "transitions_per_second"), (sample, "calls_per_second"))
    )
    yield "docs/operations.md", f"1 Gbit/s | {125 / step / 15:,.0f}"[:-3] + "000 robots"
    yield "docs/operations.md", f"a learner that makes {_hundreds(125 / batch)} updates/s"
    yield "docs/operations.md", f"A learner that wants more than {paced[1]} transitions/s needs"
    yield "benchmarks/RESULTS.md", f"{' and '.join(at_once)} as fast as both can"
    yield (
        "docs/operations.md",
        f"Measured at one hub with {most['actors']:,} actors: it acknowledged their chunks within "
        f"{most['p99_ms']:.1f} ms (p99), and weights of 6.7 MB reached all of them within "
        f"{most['weights_seconds']:.1f} s.",
    )
    updates = next(
        row["ours/s"]
        for row in result("peers")["rows"]
        if row["work"] == "updates of 32, 2 threads"
    )
    yield "docs/operations.md", f"two cores learn from {_hundreds(32 * updates)} transitions/s"
    yield "docs/operations.md", f"updates of 32 every 4 steps) | {4 * updates // 15:.0f} robots"
    yield "benchmarks/RESULTS.md", f"for up to {4 * updates // 15:.0f} robots in real time"

    peer, ours = (
        sorted(
            row[whose]
            for name in ("peers_training", "peers_training_again")
            for row in result(name)["rows"]
            if row["work"].endswith("of 32") and row["peer"].endswith("2 threads")
        )
        for whose in ("peer/s", "ours/s")
    )
    yield "docs/comparison.md", f"| {peer[0]:.0f} to {peer[1]:.0f} ([DQN]"
    yield "docs/comparison.md", f"| {ours[0]:.0f} to {ours[1]:.0f}, the same"


def _hundreds(number: float) -> str:
    return f"{round(number, -2):,.0f}"


@pytest.mark.parametrize(("page", "sentence"), [*stated()])
def test_a_page_states_what_was_measured(page: str, sentence: str) -> None:
    text = " ".join((ROOT / page).read_text(encoding="utf-8").split())
    assert sentence in text


def test_each_table_of_speed_is_made_by_make_bench() -> None:
    page = PAGE.read_text(encoding="utf-8")
    speed = re.search(r"^## Speed$.*?(?=^## )", page, re.DOTALL | re.MULTILINE)
    assert speed is not None
    tables = {*re.findall(r"<!-- ([\w-]+)\.json", speed[0])}
    made = {name for benchmark in BENCHMARKS.values() for name in benchmark.published}
    assert not tables - made - {*_MADE_ELSEWHERE}
    assert {*_MADE_ELSEWHERE} <= tables


def test_the_goals_of_speed_are_counted() -> None:
    """Each status begins with one of three words; the sentence above has their numbers."""
    page = PAGE.read_text(encoding="utf-8")
    page = page[page.index("## Speed") :]
    table = page[page.index("| quantity | goal |") :].split("\n\n")[0].splitlines()[2:]
    counts = Counter(re.split(r"[ :;(]", row.split("|")[-2].strip())[0] for row in table)
    assert counts.keys() == {"reached", "in", "missed"}
    told = f"{counts['reached']} are reached (one of them with tests beside training), "
    told += f"{counts['in']} in part, and {counts['missed']} are missed"
    assert f"**Of {len(table)} goals of speed, {told}.**" in page
