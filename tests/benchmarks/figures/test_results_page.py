"""The page of results: its tables are those of the files, word for word."""

import json
from pathlib import Path

import pytest

from benchmarks.figures.results_page import PAGE, render
from benchmarks.lab.ladder import COLUMNS, add_row
from common.errors import InputError
from common.run.epochs import EpochPhase, EpochRow, EpochTable
from tests.epoch_rows import epoch_row

MEASUREMENT = {
    "title": "Speed of two things",
    "rows": [{"what": "this", "per second": 1234.56}, {"what": "that", "per second": None}],
    "kinds": [{"of what": "one"}],
    "versions": {"torch": "2.13.0"},
    "git_commit": "0123456789abcdef",
    "machine": {"cpu": "A processor", "cores": 2},
}


def test_a_table_stands_between_its_marks(tmp_path: Path) -> None:
    (tmp_path / "speed.json").write_text(json.dumps(MEASUREMENT))
    page = "# Results\n\n<!-- speed.json -->\nan old table\n<!-- end -->\n\nMore.\n"
    expected = """# Results

<!-- speed.json -->
Speed of two things

| what | per second |
| --- | ---: |
| this | 1,234.6 |
| that | – |

A processor, 2 cores, torch 2.13.0, commit 0123456.
<!-- end -->

More.
"""
    once = render(page, tmp_path)
    assert once == expected
    assert render(once, tmp_path) == once
    assert render(page.replace("an old table\n", ""), tmp_path) == expected


def test_a_measurement_of_a_checkout_that_is_not_installed_does_not_know_its_torch(
    tmp_path: Path,
) -> None:
    (tmp_path / "speed.json").write_text(json.dumps(MEASUREMENT | {"versions": {"python": "3.12"}}))
    page = render("<!-- speed.json -->\n<!-- end -->\n", tmp_path)
    assert "\nA processor, 2 cores, commit 0123456.\n" in page


def test_what_was_learned_is_a_row_for_each_run(tmp_path: Path) -> None:
    run: dict[str, object] = dict.fromkeys(COLUMNS, "")
    run |= {"rung": "R5", "game": "pong", "seed": 1, "agent_steps": 995_520, "wall_seconds": 9_000}
    run |= {"random_reward": -20.73, "mean": 20.7, "deviation": 0.651}
    run |= {"iqm": 21, "iqm_low": 20.694, "iqm_high": 21.0}
    run |= {"steps_to_0": 500_528, "steps_to_human": 700_720, "git_commit": "0123456789abcdef"}
    others: tuple[dict[str, object], ...] = (
        {"label": "vector", "seed": 2},
        {"label": "vector"},
        {},
    )
    for other in others:  # in the order of rungs, labels and seeds, whenever they were made
        row = run | other
        add_row(tmp_path / "ladder.csv", row | {"flags": f"--seed {row['seed']}"})
    page = "<!-- ladder.csv -->\n<!-- end -->\n"
    names = "| rung | game | seed | random | score of a game | IQM (95 %) | ≥ 0 | ≥ 9.3 | ≥ 18 |"
    figures = "-20.7 | 20.70 ± 0.65 | 21.00 (20.69 to 21.00) | "
    figures += "501K | 701K | – | 996K | 2.5 | 0123456 |"
    expected = f"""<!-- ladder.csv -->
{names} steps | hours | commit |
| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | --- |
| R5 | pong | 1 | {figures}
| R5, vector | pong | 1 | {figures}
| R5, vector | pong | 2 | {figures}
<!-- end -->
"""
    assert render(page, tmp_path) == expected == render(expected, tmp_path)


def test_a_table_of_several_stands_under_its_name(tmp_path: Path) -> None:
    (tmp_path / "speed.json").write_text(json.dumps(MEASUREMENT))
    expected = """<!-- speed.json kinds -->
| of what |
| --- |
| one |

A processor, 2 cores, torch 2.13.0, commit 0123456.
<!-- end -->
"""
    empty = "<!-- speed.json kinds -->\n<!-- end -->\n"
    for page in (empty, expected):
        assert render(page, tmp_path) == expected
        assert render(f"{page}And\n{page}", tmp_path) == f"{expected}And\n{expected}"


def test_a_race_is_a_row_for_each_run(tmp_path: Path) -> None:
    scores = [(0.001, 0.0, 19.87, 1.14), (0.05, 0.0, 8.5, 7.2), (0.001, 0.25, 2.0, 7.4)]
    names = ("epsilon", "sticky", "mean", "deviation")
    tested = {"seconds": 540.0, "agent_steps": 160_600}
    run = {
        **{"seed": 1, "agent_steps": 260_224, "wall_seconds": 731.0, "steps_per_second": 356.15},
        "training": {"0": {"seconds": 557.4, "agent_steps": 202_368}, "9.3": None, "18": None},
        "test": {"0": tested, "9.3": tested, "18": None},
        "headline": [dict(zip(names, row, strict=True)) for row in scores],
    }
    (tmp_path / "race_ale.json").write_text(json.dumps(MEASUREMENT | {"runs": [run]}))
    expected = """<!-- race_ale.json -->
| seed | agent steps | minutes | steps/s | ≥ 0 | ≥ 9.3 | ≥ 18 | tests ≥ 0, 9.3, 18 | ε = 0.001 | ε = 0.05 | ε = 0.001, sticky 0.25 |
| ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |
| 1 | 260,224 | 12.2 | 356 | 9.3 (202K) | – | – | 9.0 (161K), 9.0 (161K), – | 19.87 ± 1.14 | 8.50 ± 7.20 | 2.00 ± 7.40 |

A processor, 2 cores, torch 2.13.0, commit 0123456.
<!-- end -->
"""  # noqa: E501
    assert render("<!-- race_ale.json -->\n<!-- end -->\n", tmp_path) == expected


def test_how_fast_each_run_learned_is_told_by_its_epochs(tmp_path: Path) -> None:
    def row(phase: EpochPhase, steps: int, scores: list[float]) -> EpochRow:
        return epoch_row(scores, epoch=1, phase=phase, total_train_steps=steps)

    first, second = (EpochTable(tmp_path / f"ladder-R1-pong-seed-{seed}.csv") for seed in (1, 2))
    first.append(row("train", 50_048, [-21, -20]))
    first.append(row("train", 100_096, [-19, -18, -18]))
    first.append(row("test", 100_096, [21]))
    first.append(row("train", 150_144, [5]))
    first.append(row("train", 200_192, []))
    second.append(row("train", 310_000, [3.25]))
    second.append(row("train", 425_000, [4]))
    second.append(row("train", 780_000, [19]))
    second.append(row("train", 799_000, [20]))
    second.append(row("train", 802_000, [21]))
    expected = """<!-- ladder-*-pong-*.csv -->
| run | 100K | 200K | 250K | 300K | 400K | 500K | 600K | 800K | 1,000K |
| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |
| R1-pong-seed-1 | -18.3 | – | – | – | – | – | – | – | – |
| R1-pong-seed-2 | – | – | – | 3.2 | – | – | – | 20.0 | – |
<!-- end -->
"""
    assert render("<!-- ladder-*-pong-*.csv -->\n<!-- end -->\n", tmp_path) == expected
    assert render(expected, tmp_path) == expected


def test_a_file_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="none"):
        render("<!-- none.json -->\n<!-- end -->\n", tmp_path)


def test_the_published_page_is_that_of_its_files() -> None:
    page = PAGE.read_text()
    assert render(page, PAGE.parent / "results") == page
