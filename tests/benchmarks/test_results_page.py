"""The page of results: its tables are those of the files, word for word."""

import json
from pathlib import Path

import pytest

from benchmarks.results_page import PAGE, render
from common.errors import InputError

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


def test_a_file_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="none"):
        render("<!-- none.json -->\n<!-- end -->\n", tmp_path)


def test_the_published_page_is_that_of_its_files() -> None:
    page = PAGE.read_text()
    assert render(page, PAGE.parent / "results") == page
