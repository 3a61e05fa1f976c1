"""The registry: every benchmark that it names is a module, and nothing is measured outside it."""

import errno
import importlib
import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import is_dataclass
from pathlib import Path

import pytest
import tyro

from benchmarks import __main__ as command
from benchmarks import scaling
from benchmarks.lab import __main__ as lab
from benchmarks.registry import BENCHMARKS, RESULTS, experiments
from benchmarks.report import BenchmarkOptions, Report, run, write
from common.command_line.parser import check_bounds
from common.errors import InputError
from tests.paths import ROOT


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_benchmark_is_a_module_that_takes_its_published_flags(name: str) -> None:
    module = importlib.import_module(f"benchmarks.{name}")
    kind: type[BenchmarkOptions] = module.Options
    assert is_dataclass(kind)
    assert f'main("{name}", Options, measure)' in Path(module.__file__ or "").read_text()
    for result, flags in BENCHMARKS[name].published.items():
        options = tyro.cli(kind, args=shlex.split(flags))
        options.check()
        published = json.loads((RESULTS / f"{result}.json").read_text())
        assert {"title", "rows", "machine", "git_commit"} <= set(published)


def test_numbers_out_of_bounds_are_refused_with_their_flag() -> None:
    for name, value in (("seconds", 0.0), ("actors", 0), ("numbers", ())):
        with pytest.raises(InputError, match=name):
            check_bounds(scaling.Options(**{name: value}))  # type: ignore[arg-type]
    check_bounds(scaling.Options(learner="--threads 1 " * 100, numbers=(3,)))


def test_results_outlast_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of an experiment of days are written anew after each of its runs."""
    file = tmp_path / "results.json"
    write(file, {"runs": [1]})

    def refuse(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(InputError, match=r"results\.json cannot be written \(No space left"):
        write(file, {"runs": [1, 2]})
    assert json.loads(file.read_bytes())["runs"] == [1]


def test_every_module_that_measures_is_registered() -> None:
    modules = (ROOT / "benchmarks").glob("*.py")
    named = [re.findall(r'^    main\("(\w+)"', each.read_text(), re.MULTILINE) for each in modules]
    assert {name for names in named for name in names} == set(BENCHMARKS)


def test_every_experiment_ends_with_what_it_started() -> None:
    """`main` does so: SIGTERM would leave the processes of a program that ends in its own way."""
    programs = {
        module.stem: text.partition('if __name__ == "__main__":\n')[2].strip()
        for module in (ROOT / "benchmarks" / "lab").glob("*.py")
        if module.stem != "__main__" and "__main__" in (text := module.read_text())
    }
    assert len(programs) > 10
    others = {name for name, end in programs.items() if not end.startswith(f'main("lab.{name}", ')}
    assert not others


def test_all_are_run_with_their_published_flags(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[Sequence[str]] = []
    monkeypatch.setattr(command, "run_module", lambda *words: told.append(words))
    command.main(["all"])
    assert len(told) == sum(len(each.published) for each in BENCHMARKS.values())
    (robot,) = [words for words in told if words[-1].endswith("epochs_robot.json")]
    assert robot[:-2] == (
        "benchmarks.epochs_per_day",
        *("--env", "robot"),
        "--learner=--envs 2 --learning.batch-size 128 --learning.train-period 16 "
        "--learning.publish-period 12",
        *("--evaluators", "2"),
    )
    assert all(words[-2] == "--json" for words in told)


def test_without_a_name_all_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    command.main([])
    listed = capsys.readouterr().out
    assert all(name in listed for name in BENCHMARKS)


def test_every_experiment_is_listed_with_what_it_measures(
    capsys: pytest.CaptureFixture[str],
) -> None:
    lab.main([])
    listed = capsys.readouterr().out
    programs = {
        module.stem
        for module in (ROOT / "benchmarks" / "lab").glob("*.py")
        if f'    main("lab.{module.stem}"' in module.read_text()
    }
    assert programs == set(experiments())
    assert all(name in listed and measures for name, measures in experiments().items())
    with pytest.raises(InputError, match="race is an experiment: `python -m"):
        command.main(["race"])
    with pytest.raises(InputError, match=r"no experiment rice: did you mean race\?$"):
        lab.main(["rice"])


@pytest.mark.parametrize("words", [["nothing"], ["all", "--seconds", "1"]])
def test_what_cannot_be_run_is_refused(words: list[str]) -> None:
    with pytest.raises(InputError, match="benchmark"):
        command.main(words)


@pytest.mark.usefixtures("forks")
def test_one_is_run_by_its_name_with_its_own_flags() -> None:
    words = [sys.executable, "-m", "benchmarks", "replay", "--sizes", "1"]
    ended = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert "choose sizes of 256 or more" in ended.stderr


def test_a_benchmark_from_outside_has_the_same_table_and_json(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def measure(options: BenchmarkOptions) -> Report:
        return Report.of("A title", [{"what": "x", "rate": 2.5}], {"more": 1}, "A sentence.")

    file = tmp_path / "new.json"
    run("new", BenchmarkOptions, measure, ["--json", str(file)])
    printed = capsys.readouterr().out
    assert "A title" in printed
    assert "A sentence." in printed
    found = json.loads(file.read_text())
    assert list(found)[:3] == ["title", "more", "rows"]
    assert found["rows"] == [{"what": "x", "rate": 2.5}]
    assert found["machine"]["cores"] > 0
    run("new", BenchmarkOptions, measure, ["--json", str(tmp_path / "none" / "new.json")])
    assert (tmp_path / "none" / "new.json").exists()
    with pytest.raises(InputError, match="cannot be written"):
        run("new", BenchmarkOptions, measure, ["--json", str(file / "new.json")])
    with pytest.raises(InputError, match="there is no flag --jsn: did you mean --json"):
        run("new", BenchmarkOptions, measure, ["--jsn", str(file)])
