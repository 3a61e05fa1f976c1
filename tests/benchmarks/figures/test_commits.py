"""Results and pages name commits of this repository, or say that a commit is lost."""

import csv
import json
import re
import shlex
import subprocess
from functools import cache
from pathlib import Path

import pytest

from benchmarks.figures.commits import Source, sources
from benchmarks.figures.results_page import PAGE, render
from tests.paths import ROOT

RESULTS = PAGE.parent / "results"


SETTINGS = ("config", "conditions", "ranges")
"""Modules of `common/settings` that declare settings."""
LOST = {"26313b4"}
"""Commits of results, whose notes say that they are lost; no other may join them."""
A_COMMIT = re.compile(
    r"(?<![-=\w])(?=[0-9a-f]*[a-f])(?=[0-9a-f]*[0-9])([0-9a-f]{40}|[0-9a-f]{7,12})\b(?!-seed)"
)
"""A commit of any usual length; not the hash in the name of a run, or of a file after its name."""


def git(*arguments: str) -> str:
    answer = subprocess.run(
        ["git", "-C", str(ROOT), *arguments], capture_output=True, text=True, check=True
    )
    return answer.stdout


@pytest.fixture(scope="module")
def history() -> set[str]:
    """Commits that lead to the one that is checked out."""
    try:
        shallow = git("rev-parse", "--is-shallow-repository").strip() == "true"
        git("ls-files", "--error-unmatch", str(PAGE))
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no git, or no checkout of this repository")
    if shallow:
        pytest.skip("a shallow clone does not have the results' commits")
    return set(git("rev-list", "HEAD").split())


def test_the_commit_of_each_result_is_in_the_history_or_noted_as_lost(history: set[str]) -> None:
    found = list(sources(RESULTS))
    assert len(found) > 40
    lost = {each for each in found if each.commit not in history}
    told = {each for each in found if "not in this repository's history" in each.note}
    assert lost == told
    assert {each.commit[:7] for each in lost} == LOST


def test_every_commit_that_a_page_a_result_or_a_card_names_is_in_the_history(
    history: set[str],
) -> None:
    named = {
        (file, commit)
        for file in git("ls-files", "*.md", "*.json", "*.csv").split()
        for commit in A_COMMIT.findall((ROOT / file).read_text(encoding="utf-8"))
    }
    assert {"CHANGELOG.md", "CONTRIBUTING.md", "policies/ale_pong.json"} < {
        file for file, _ in named
    }
    there = {commit[:length] for commit in history for length in (*range(7, 13), 40)}
    gone = {
        (file, commit) for file, commit in named if commit not in there and commit[:7] not in LOST
    }
    assert not gone


def test_the_flags_of_each_row_are_known_at_its_commit(history: set[str]) -> None:
    @cache
    def settings_at(commit: str) -> str:
        folders = ("", "run/", "settings/")  # where they have lived
        held = [f"common/{folder}{name}.py" for folder in folders for name in SETTINGS]
        there = git("ls-tree", "-r", "--name-only", commit, "--", *held).split()
        return "".join(git("show", f"{commit}:{file}") for file in there)

    checked = 0
    for table in (RESULTS / "ladder.csv", RESULTS / "ablations.csv"):
        with table.open(newline="") as file:
            for row in csv.DictReader(file):
                if row["git_commit"] not in history:
                    continue
                for flag in re.findall(r"--\w+\.(?:no-)?([\w-]+)", row["flags"]):
                    name = flag.replace("-", "_")
                    text = settings_at(row["git_commit"])
                    assert re.search(rf"^    {name}: ", text, re.MULTILINE), (row["flags"], flag)
                    checked += 1
    assert checked > 10


def test_a_row_has_the_flags_that_its_label_promises() -> None:
    """Until 86c4c15 the preset robot had the vector unless told otherwise."""
    with (RESULTS / "ladder.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            flags = shlex.split(row["flags"])
            assert ("--play.vector" in flags) == row["label"].startswith("vector")
            if row["rung"] == "R5":
                assert ("--play.no-vector" in flags) == (row["label"] == "")


def test_every_result_that_names_a_commit_is_found(tmp_path: Path) -> None:
    origin = {"git_commit": "a" * 40, "git_dirty": False}
    inner = {"git_commit": "b" * 40, "git_dirty": True}
    runs = [{**origin, "tests": [1]}, inner]
    content = {"rungs": {"R1": inner, "R2": {}}, "rows": [1], "runs": runs, **origin}
    (tmp_path / "one.json").write_text(json.dumps(content))
    (tmp_path / "ladder.csv").write_text(
        "rung,label,game,seed,git_commit,git_dirty,note\n"
        f"R1,,pong,2,{'c' * 40},False,\nR2,x,pong,1,{'c' * 40},True,a note\n"
    )
    (tmp_path / "late.csv").write_text(f"network,press,git_commit\nnet,3,{'d' * 40}\n")
    (tmp_path / "epochs.csv").write_text("epoch,phase\n1,train\n")
    found = list(sources(tmp_path))
    assert found == [
        Source("ladder.csv", "R1, pong, 2", "c" * 40, False, ""),
        Source("ladder.csv", "R2, x, pong, 1", "c" * 40, True, "a note"),
        Source("late.csv", "net", "d" * 40, None, ""),
        Source("one.json", "", "a" * 40, False, ""),
        Source("one.json", "rungs R1", "b" * 40, True, ""),
        Source("one.json", "runs 1", "a" * 40, False, ""),
        Source("one.json", "runs 2", "b" * 40, True, ""),
    ]
    page = render("<!-- not reproducible -->\n<!-- end -->\n", tmp_path)
    assert page.splitlines()[3:-1] == [
        "| ladder.csv | R2, x, pong, 1 | ccccccc+ | a note; tracked files differed |",
        "| late.csv | net | ddddddd | unknown whether tracked files differed |",
        "| one.json | rungs R1; runs 2 | bbbbbbb+ | tracked files differed |",
    ]
