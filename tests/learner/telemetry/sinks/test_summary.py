"""``summary.json`` and where its versions and commit come from."""

import json
import math
import platform
import re
import subprocess
import tomllib
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest

from common.press_latency import Delay
from common.run.presets import PRESETS
from learner.telemetry import provenance
from learner.telemetry.provenance import Machine, Provenance, git_state, package_versions
from learner.telemetry.sinks.summary import epochs_per_day, write_summary
from learner.telemetry.status import ActorStatus, ChunkCounts, ClockMode, Gate, Status, TimeCounts
from tests.paths import ROOT

STATUS = Status(
    run="pong-1",
    preset="paper",
    env="ale",
    game="pong",
    device="cpu",
    phase="finishing",
    elapsed=3_600.0,
    agent_steps=300_000,
    warmup=50_000,
    warmup_done=50_000,
    epoch=2,
    epoch_steps=250_000,
    updates=62_500,
    mean_max_q=1.25,
    test_reward=-19.5,
    test_epoch=2,
    test_history=(-19.0, -19.5),
    samples_per_insert=8.01,
    samples_per_insert_goal=8.0,
    staleness_p50=12.0,
    staleness_p95=48.0,
    weights_version=1_250,
    stored=300_000,
    capacity=1_000_000,
    chunks=ChunkCounts(made=4_690, acked=4_688, retried=3, duplicate=1, refused=2),
    valid_frame_share=1.0,
    press_match_share=0.75,
    press_in_all=Delay(1_224, 50.0, math.inf, 66.5),
    actors=(ActorStatus(name="actor-0", role="actor", alive=True, steps=300_000),),
    gates=(Gate(name="valid frames", value=1.0, passed=True, bound="≥ 0.99", why="no screen"),),
)
PROVENANCE = Provenance(
    versions={"python": "3.11.9", "torch": "2.13.0"},
    git_commit="a" * 40,
    git_dirty=False,
    machine=Machine(system="Linux", cpu="a processor", cores=2, memory_bytes=2**33),
)


CLOCK = ClockMode(sync=False, wait_action=True, speed=0.5)


def written(path: Path, status: Status = STATUS, clock: ClockMode | None = CLOCK) -> Any:
    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    write_summary(
        path,
        status,
        PRESETS["paper"],
        PROVENANCE,
        clock,
        initial=False,
        train_steps_per_second=250.0,
        test_steps_per_second=500.0,
    )
    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


def test_what_went_wrong_with_time_is_told(tmp_path: Path) -> None:
    time = TimeCounts(
        steps=150, decisions=300, missed_deadlines=20, late_frames=14, waits_given_up=4
    )
    summary = written(tmp_path / "summary.json", replace(STATUS, time=time))
    assert summary["decisions_per_step"] == 2.0
    assert summary["missed_deadlines"] == 20
    assert summary["late_frames"] == 14
    assert summary["waits_given_up"] == 4
    nobody = written(tmp_path / "summary.json")
    assert nobody["decisions_per_step"] is None


def test_how_time_passed_is_told_where_it_is_known(tmp_path: Path) -> None:
    for clock, expected in ((CLOCK, (False, True, 0.5)), (None, (None, None, None))):
        summary = written(tmp_path / "summary.json", clock=clock)
        assert (summary["sync"], summary["wait_action"], summary["speed"]) == expected


def test_figures_of_the_run(tmp_path: Path) -> None:
    summary = written(tmp_path / "summary.json")
    expected = {
        "agent_steps": 300_000,
        "updates": 62_500,
        "samples_per_insert": 8.01,
        "chunks": {"made": 4_690, "acked": 4_688, "retried": 3, "duplicate": 1, "refused": 2},
        "weights_version": 1_250,
        "staleness_updates": {"p50": 12.0, "p95": 48.0},
        "steps_per_second": 250.0,
        # 250,000 / 250 + 125,000 / 500 = 1,250 s; 86,400 / 1,250
        "epochs_per_day": 69.12,
        "mean_max_q": 1.25,
        "valid_frame_share": 1.0,
        "press_match_share": 0.75,
        "press_ms": {"measured": 1_224, "p50": 50.0, "p99": None, "watched": 66.5},
        "release_ms": {"measured": 0, "p50": None, "p99": None, "watched": 0.0},
        "versions": {"python": "3.11.9", "torch": "2.13.0"},
        "git_commit": "a" * 40,
        "git_dirty": False,
        "best_test_reward": -19.0,
        "seed": 1,
        "initial": False,
    }
    assert {name: summary[name] for name in expected} == expected
    assert summary["machine"]["cores"] == 2
    assert summary["config"]["learning"]["batch_size"] == 32
    assert summary["gates"][0]["bound"] == "≥ 0.99"
    assert summary["actors"][0]["steps"] == 300_000


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, None])
def test_what_is_no_number_is_null(tmp_path: Path, value: float | None) -> None:
    gate = replace(STATUS.gates[0], value=value)
    diverged = replace(STATUS, mean_max_q=value, staleness_p95=value, gates=(gate,))
    summary = written(tmp_path / "summary.json", diverged)
    assert summary["mean_max_q"] is None
    assert summary["staleness_updates"] == {"p50": 12.0, "p95": None}
    assert summary["gates"][0]["value"] is None


def test_rate_before_the_first_epoch_is_that_of_the_moment(tmp_path: Path) -> None:
    path = tmp_path / "summary.json"
    write_summary(
        path,
        replace(STATUS, steps_per_second=125.0),
        PRESETS["paper"],
        PROVENANCE,
        CLOCK,
        initial=False,
        train_steps_per_second=None,
        test_steps_per_second=125.0,
    )
    summary = json.loads(path.read_text(encoding="utf-8"))
    assert summary["steps_per_second"] == 125.0
    assert summary["epochs_per_day"] == 28.8  # 375,000 steps at 125 in 3,000 s


def test_epochs_are_the_reports_whatever_the_runs_are(tmp_path: Path) -> None:
    path = tmp_path / "summary.json"
    write_summary(
        path,
        STATUS,
        PRESETS["fast"],
        PROVENANCE,
        CLOCK,
        initial=False,
        train_steps_per_second=250.0,
        test_steps_per_second=500.0,
    )
    assert PRESETS["fast"].protocol.epoch_steps < 250_000
    assert json.loads(path.read_text(encoding="utf-8"))["epochs_per_day"] == 69.12


def test_an_older_summary_is_replaced_whole(tmp_path: Path) -> None:
    path = tmp_path / "summary.json"
    path.write_text("x" * 100_000)
    assert written(path)["run"] == "pong-1"
    assert [entry.name for entry in tmp_path.iterdir()] == ["summary.json"]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ((250_000, 125_000, 126.0, 352.0), 36.94),  # the rates of ALE-Only in 2017
        ((250_000, 0, 250.0, None), 86.4),
        ((250_000, 125_000, 250.0, None), None),
        ((250_000, 125_000, 0.0, 500.0), None),
        ((250_000, 125_000, None, 500.0), None),
    ],
)
def test_epochs_per_day(arguments: Any, expected: float | None) -> None:
    assert epochs_per_day(*arguments) == pytest.approx(expected, abs=0.005)


def test_versions_of_all_that_pyproject_names() -> None:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    project = tomllib.loads(text)["project"]
    named = {re.split(r"[<>=~!\[; ]", text)[0] for text in project["dependencies"]}
    assert set(provenance.PACKAGES) == named | {project["name"]}
    versions = package_versions()
    assert versions["python"] == platform.python_version()
    assert versions["torch"] == metadata.version("torch")


def git(folder: Path, *arguments: str) -> str:
    who = ["-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false"]
    command = ["git", *who, "-C", str(folder), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / "code.py").write_text("a = 1\n")
    git(tmp_path, "init", "--quiet")
    git(tmp_path, "add", "package/code.py")
    git(tmp_path, "commit", "--quiet", "-m", "first")
    return tmp_path


def test_commit_of_the_checkout(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = checkout / "package" / "code.py"
    head = git(checkout, "rev-parse", "HEAD")
    monkeypatch.chdir("/")
    monkeypatch.setenv("GIT_DIR", "/nowhere")  # as inside a hook of another repository
    assert git_state(file) == (head, False)
    (checkout / "notes.txt").write_text("untracked files do not count")
    assert git_state(file) == (head, False)
    file.write_text("a = 2\n")
    assert git_state(file) == (head, True)


def test_no_commit_for_code_that_is_only_installed_in_a_checkout(checkout: Path) -> None:
    installed = checkout / ".venv" / "code.py"
    installed.parent.mkdir()
    installed.write_text("a = 1\n")
    assert git_state(installed) == (None, None)


def test_no_commit_without_git(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    assert git_state(checkout / "package" / "code.py") == (None, None)


def test_gathering_here() -> None:
    found = Provenance.gather()
    assert found.versions == package_versions()
    assert found.git_commit is None or re.fullmatch("[0-9a-f]{40}", found.git_commit)
    assert found.machine.cores >= 1
    assert found.machine.memory_bytes > 2**26
