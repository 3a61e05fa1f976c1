"""Where versions, commit and machine of a result come from."""

import platform
import re
import subprocess
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from learner.telemetry.provenance import (
    git_state,
    gpu_models,
    machine_line,
    package_versions,
    provenance,
)
from tests.paths import ROOT


def test_versions_of_all_that_pyproject_names() -> None:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    project = tomllib.loads(text)["project"]
    named = {re.split(r"[<>=~!\[; ]", text)[0] for text in project["dependencies"]}
    versions = package_versions()
    assert versions.keys() == named | {project["name"], "python"}
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


def test_the_driver_tells_the_gpus(tmp_path: Path) -> None:
    for number, model in enumerate(("NVIDIA H200", "NVIDIA GeForce RTX 4090")):
        (tmp_path / f"0000:0{number}:00.0").mkdir()
        told = f"Model: \t\t {model}\nIRQ:   \t\t 16\nGPU UUID: \t ?\n"
        (tmp_path / f"0000:0{number}:00.0" / "information").write_text(told, encoding="utf-8")
    gpus = gpu_models(tmp_path)
    assert gpus == ["NVIDIA H200", "NVIDIA GeForce RTX 4090"]
    assert gpu_models(tmp_path / "none") == []
    assert machine_line({"cpu": "a processor", "cores": 2, "gpus": gpus[:1]}) == (
        "a processor, 2 cores, NVIDIA H200"
    )
    assert machine_line({"cpu": "a processor", "cores": 2}) == "a processor, 2 cores"
    assert machine_line({"cpu": None, "cores": 2, "gpus": []}) == "None, 2 cores"


def test_gathering_here() -> None:
    found = provenance()
    assert found.keys() == {"versions", "git_commit", "git_dirty", "machine"}
    assert found["versions"] == package_versions()
    assert found["git_commit"] is None or re.fullmatch("[0-9a-f]{40}", found["git_commit"])
    assert found["machine"].keys() == {"system", "cpu", "cores", "memory_bytes", "gpus"}
    assert found["machine"]["cores"] >= 1
    assert found["machine"]["memory_bytes"] > 2**26
    assert found["machine"]["cpu"] is None or found["machine"]["cpu"].strip()
