"""The list of the runs of a folder."""

import json
import os
import time
from datetime import date
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from common.errors import InputError
from common.process.log_lines import kept_log
from common.run.folder import RunFolder
from common.run.newest_learner import Ended, NewestLearner
from common.settings.presets import PRESETS
from learner.runs import main

YEAR = date.today().year


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with an ended run, one that failed, one without figures, one that is at
    work, and what is no run."""
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.chdir(tmp_path)
    for name in ("busy", "done", "ended", "failed", "killed", "new"):
        folder = RunFolder(Path("runs"), name)
        folder.path.mkdir(parents=True)
        folder.config_file.write_text("{}")
    write_newest("done", ended="done")
    write_newest("killed")
    played = (("busy", 5_000), ("done", 9), ("ended", 1_200_000), ("failed", 300), ("killed", 8))
    for name, steps in played:
        summary = RunFolder(Path("runs"), name).summary
        told = {"env": "robot", "game": "pong", "agent_steps": steps, "wall_seconds": 3_630.0}
        summary.write_text(json.dumps({**told, "train_reward": 18.0, "best_test_reward": -2.5}))
        year = 2024 if name == "killed" else YEAR
        os.utime(summary, (0, time.mktime((year, 11, 29, 7, 57, 0, 0, 0, -1))))
    with (
        pytest.raises(ValueError, match="boom"),
        kept_log(Path("runs/failed/logs/learner.jsonl"), "learner"),
    ):
        raise ValueError("boom")
    (tmp_path / "runs" / "notes").mkdir()
    (tmp_path / "runs" / "my run").mkdir()
    (tmp_path / "runs" / "my run" / "config.json").touch()
    return tmp_path / "runs"


def write_newest(name: str, address: str = "tcp/h:1", ended: Ended | None = None) -> RunFolder:
    """Writes what the newest learner of a run says of itself; returns the run."""
    folder = RunFolder(Path("runs"), name)
    real = str(folder.path.resolve())
    NewestLearner(real, address, None, "/", "go on", keeps_snapshots=False, ended=ended).write(
        folder
    )
    return folder


def claimed(address: str) -> RunFolder:
    """The run at which this process works from now on."""
    folder = write_newest("busy", address)
    folder.config_file.unlink()
    folder.claim("learner", PRESETS["fast"], resume=False)
    return folder


def listed(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[str]:
    main(arguments)
    return [line.strip() for line in capsys.readouterr().out.splitlines()]


@pytest.mark.parametrize(
    ("address", "state"),
    [
        ("tcp/127.0.0.1:7447", "at work"),
        ("tcp/h:7447", "at work at tcp/h:7447"),
        ("tcp/h:1", "at work at tcp/h:1"),
    ],
)
def test_each_run_has_its_figures_and_its_state(
    runs: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    address: str,
    state: str,
) -> None:
    folder = claimed(address)
    monkeypatch.setattr("learner.runs.date", SimpleNamespace(today=lambda: date(YEAR, 11, 30)))
    head, rule, *rows, _, last = listed(capsys)[2:]
    assert head.split() == ["run", "plays", "steps", "time", "train", "test", "state"]
    assert set(rule) == {"─"}
    assert [" ".join(row.split()) for row in rows] == [
        f"busy pong (robot) 5,000 1:00:30 18.00 −2.50 {state}",
        "done pong (robot) 9 1:00:30 18.00 −2.50 done 11-29",
        "ended pong (robot) 1,200,000 1:00:30 18.00 −2.50 ended 11-29",
        "failed pong (robot) 300 1:00:30 18.00 −2.50 failed 11-29",
        "killed pong (robot) 8 1:00:30 18.00 −2.50 killed 2024-11-29",
        "new – – – – – ended",
    ]
    assert last == "One of them: ale-robot status RUN"
    assert folder.is_at_work()
    monkeypatch.setattr("learner.runs.date", SimpleNamespace(today=lambda: date(YEAR, 11, 29)))
    assert any(line.endswith("done 07:57") for line in listed(capsys))  # of today


def test_the_list_as_json_has_all_figures(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = claimed("tcp/h:1")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    main([str(runs), "--json"])
    told: list[dict[str, Any]] = json.loads(capsys.readouterr().out)
    assert [each["run"] for each in told] == ["busy", "done", "ended", "failed", "killed", "new"]
    states = ["at work", "done", "ended", "failed", "killed", "ended"]
    assert [each["state"] for each in told] == states
    assert [each["error"] for each in told] == [None, None, None, "boom", None, None]
    del told[:2], told[2]
    assert told[0]["folder"] == str(runs / "ended")
    assert (told[0]["written"], told[0]["summary"]["agent_steps"]) == (
        f"{YEAR}-11-29 07:57",
        1_200_000,
    )
    assert (told[2]["written"], told[2]["summary"]) == (None, None)
    monkeypatch.chdir(tmp_path)
    assert folder.is_at_work()


def test_a_run_that_cannot_be_looked_at_hides_no_other(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (runs / "done/.learner.lock").mkdir()  # as a file of another user cannot be opened
    main(["--json"])
    states = {each["run"]: each["state"] for each in json.loads(capsys.readouterr().out)}
    assert (states["done"], states["new"]) == ("unknown", "ended")
    assert "unknown" in listed(capsys)[5]


def test_its_json_can_be_read_whatever_a_run_has_written(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (runs / "ended/summary.json").write_text('{"a":' * 900 + "1" + "}" * 900)
    log = runs / "ended/logs/learner.jsonl"
    log.parent.mkdir()
    log.write_text(json.dumps({"level": "error", "message": "caf\u00e9 \U0001f600"}))
    main(["--json"])
    printed = capsys.readouterr().out
    assert printed.isascii()
    (told,) = (each for each in json.loads(printed) if each["run"] == "ended")
    assert (told["error"], told["summary"]) == ("caf\u00e9 \U0001f600", None)


def test_runs_of_another_checkout_are_found(
    runs: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    here = listed(capsys)
    monkeypatch.chdir("/")
    there = listed(capsys, str(runs.parent))
    assert len(here) == len(there) > 6
    assert there[-1] == f"One of them: ale-robot status {runs}/RUN"


def test_a_folder_without_runs_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert listed(capsys, str(tmp_path)) == [f"There are no runs in {tmp_path}."]
    assert listed(capsys, str(tmp_path), "--json") == ["[]"]
    monkeypatch.chdir(tmp_path)
    told = f"There are no runs in {tmp_path}/runs: `ale-robot train` begins one."
    assert listed(capsys) == [told]


@pytest.mark.parametrize("run", ["done", "runs/done"])
def test_a_run_is_no_folder_of_runs(
    runs: Path, run: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(InputError, match=rf"^{run} is a run: `ale-robot status {run}` tells of it"):
        listed(capsys, run)
    with pytest.raises(InputError, match=r"^there is no folder elsewhere: name one that"):
        listed(capsys, "elsewhere")
    Path("a_file").touch()
    with pytest.raises(InputError, match=r"^there is no folder a_file"):
        listed(capsys, "a_file")
    for name in ("runs", "elsewhere"):  # runs of these names hide no folder
        RunFolder(Path("runs"), name).path.mkdir()
        RunFolder(Path("runs"), name).config_file.write_text("{}")
    Path("elsewhere").mkdir()
    assert listed(capsys, "elsewhere")[0].startswith("There are no runs in ")
    assert len(listed(capsys)) > 6


def test_runs_of_another_folder_are_asked_by_their_folder(
    runs: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir("/")
    assert listed(capsys, str(runs))[-1] == f"One of them: ale-robot status {runs}/RUN"
