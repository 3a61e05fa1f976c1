"""Pages lead where they say, and settings are all told, as the code has them."""

import dataclasses
import json
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import get_args

import pytest

from common.metrics import METRICS, Values
from common.minus import minus_signed
from common.run.epochs import EpochPhase, EpochRow
from common.settings.config import RunConfig
from docs import metrics, settings
from learner.telemetry.sinks.curves import CurvesSink
from learner.telemetry.snapshot import Histogram
from tests.epoch_rows import epoch_row
from tests.paths import ROOT

FOLDERS = (ROOT, *(ROOT / name for name in ("benchmarks", "deploy", "docs")))
PAGES = sorted(page for folder in FOLDERS for page in folder.glob("*.md"))
LINK = re.compile(r"\]\((?P<path>[^)\s#]*)(?:#(?P<anchor>[^)\s]*))?\)")
OUTSIDE = ("http://", "https://", "mailto:")
README_WORDS = 1_200
CARDS = sorted((ROOT / "policies").glob("*.json"))


def prose(page: Path) -> str:
    """The page without blocks of code, which may look like links and headings."""
    return re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.M)


@cache
def anchors(page: Path) -> set[str]:
    """Places of a page that a link may name: those of its headings, as GitHub and MkDocs do."""
    headings = re.findall(r"^#+ (.*)$", prose(page), re.M)
    bare = (re.sub(r"[^\w\s-]", "", heading).strip().lower() for heading in headings)
    return {re.sub(r"\s", "-", heading) for heading in bare}


def broken(page: Path) -> list[str]:
    """Links of ``page`` that lead to no file, or to no heading of one."""
    found = []
    for link in LINK.finditer(prose(page)):
        if link["path"].startswith(OUTSIDE):
            continue
        target = (page.parent / link["path"]).resolve() if link["path"] else page
        if not target.exists() or (link["anchor"] and link["anchor"] not in anchors(target)):
            found.append(link[0])
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_to_a_file_and_a_heading(page: Path) -> None:
    assert not broken(page)


def test_a_link_to_nothing_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# Here\n[a](#here) [b](#there) [c](gone.md) [d](https://example.org/e)\n")
    assert broken(page) == ["](#there)", "](gone.md)"]


def test_the_site_has_every_page() -> None:
    told = set(re.findall(r": (\S+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.M))
    missing = {page.name for page in (ROOT / "docs").glob("*.md")} - told
    assert not missing, f"add {', '.join(missing)} to nav in mkdocs.yml."
    for page in told:
        sources = (ROOT / "docs" / page, (ROOT / "docs" / page).with_suffix(".ipynb"), ROOT / page)
        assert any(source.exists() for source in sources), page


def test_the_readme_is_read_in_five_minutes() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= README_WORDS


def test_every_published_policy_is_told_and_counted() -> None:
    told = set(LINK.findall(prose(ROOT / "docs" / "environments.md")))
    assert CARDS
    assert {(f"../policies/{card.name}", "") for card in CARDS} <= told
    comparison = (ROOT / "docs" / "comparison.md").read_text(encoding="utf-8")
    assert f"[{len(CARDS)}, with cards](environments.md#published-policies)" in comparison


@pytest.mark.parametrize("policy", [card.stem for card in CARDS if "pong" in card.stem])
def test_scores_of_pong_policies_are_those_of_their_cards(policy: str) -> None:
    card = json.loads((ROOT / "policies" / f"{policy}.json").read_text(encoding="utf-8"))
    scores = [
        minus_signed("{mean:.2f} ± {deviation:.2f}".format(**row))
        for row in card["evaluation"]["rows"]
    ]
    page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    rows = page[page.index("## The published policies") :].splitlines()
    row = next(row for row in rows if row.startswith(f"| `{policy}`"))
    assert [cell.strip() for cell in row.split("|")[2:-1]] == scores


@pytest.mark.parametrize("policy", [card.stem for card in CARDS if "pong" not in card.stem])
def test_scores_of_other_games_are_those_of_their_cards(policy: str) -> None:
    card = json.loads((ROOT / "policies" / f"{policy}.json").read_text(encoding="utf-8"))
    best = card["evaluation"]["rows"][0]
    page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    told = re.search(rf"`{policy}`[^`]*? ([\d,.]+) ± ([\d.]*\d)", page)
    assert told is not None
    mean, deviation = told.groups()
    places = len(mean.partition(".")[2])
    assert mean == f"{best['mean']:,.{places}f}"
    assert deviation == f"{best['deviation']:.{places}f}"


def test_the_settings_page_is_that_of_the_code() -> None:
    assert settings.PAGE.read_text(encoding="utf-8") == settings.page(), (
        "docs/settings.md is old: run python -m docs.settings."
    )


def test_the_settings_page_has_every_field() -> None:
    told = re.findall(r"^\| `(--[\w.-]+)` \|", settings.page(), re.M)
    config = dataclasses.asdict(RunConfig())
    flags = []
    for name, value in config.items():
        inner = {f"{name}.{field}" for field in value} if isinstance(value, dict) else {name}
        flags += [f"--{field}".replace("_", "-") for field in inner]
    assert sorted(told) == sorted(flags)


def test_the_settings_page_tells_bounds_and_presets() -> None:
    assert (
        "| `--learning.n-step` | integer, 1 or more | Number of agent steps of the n-step return; "
        "1 in 2017. | 1 | 5 | 5 |"
    ) in settings.page()


class _Names(CurvesSink):
    """Keeps the names of what it gets."""

    def __init__(self) -> None:
        self.found: set[str] = set()

    def add(self, points: Values, agent_steps: int) -> None:
        self.found |= {name for name, value in points.items() if value is not None}

    def add_histograms(self, found: Mapping[str, Histogram], agent_steps: int) -> None:
        self.found |= found.keys()


def test_the_page_of_figures_is_that_of_the_code() -> None:
    assert metrics.PAGE.read_text(encoding="utf-8") == metrics.page(), (
        "docs/metrics.md is old: run python -m docs.metrics."
    )


def test_the_page_of_figures_tells_units_meanings_and_where_they_are() -> None:
    assert (
        "| `play/valid_frame_share` | ratio | Share of the recent steps whose frame showed the "
        "game | frames valid |  | `valid_frames` | `valid_frame_share` | ≥ 0.99; else the screen "
        "is not found in the camera's picture |"
    ) in metrics.page()


@pytest.mark.parametrize("phase", get_args(EpochPhase))
def test_the_page_of_figures_has_each_curve_of_an_epoch(phase: str) -> None:
    sink = _Names()
    sink.phase(epoch_row([1.0], phase=phase, meanq=0.5, meancost=0.1), 1_000)
    told = set(re.findall(r"`(\w+/epoch_\w+)`", metrics.page()))
    assert sink.found <= {name.replace("PHASE", phase) for name in told}


def test_the_page_of_figures_has_each_column_of_the_epochs() -> None:
    columns = metrics.page().partition("## Columns of epochs.csv")[2]
    told = re.findall(r"^\| `(\w+)` \| .+ \|$", columns, re.M)
    assert told == [field.name for field in dataclasses.fields(EpochRow)]


def test_each_word_behind_the_number_of_actors_is_explained_where_the_screen_is() -> None:
    words = {metric.trouble for metric in METRICS.values() if metric.trouble}
    page = (ROOT / "docs" / "start.md").read_text(encoding="utf-8")
    assert words == {word for word in words if f"*{word}*" in page}
