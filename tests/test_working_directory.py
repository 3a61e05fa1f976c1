"""Programs by `python -m` in a folder that has other packages of the same names."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.paths import ROOT
from tests.patience import PATIENCE

PACKAGES = ("actors", "common", "deploy", "learner", "replay", "viewer")


def other_packages(folder: Path, but: str) -> Path:
    """A folder with a package of each name, except ``but``, that says so when it is imported."""
    for name in PACKAGES:
        if name != but:
            (folder / name).mkdir(parents=True)
            (folder / name / "__init__.py").write_text(f"raise SystemExit('another {name}')")
            (folder / name / "__main__.py").touch()
    return folder


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """A folder that holds the packages, as a folder of installed ones does."""
    (tmp_path / "installed").mkdir()
    for name in PACKAGES:
        (tmp_path / "installed" / name).symlink_to(ROOT / name)
    return tmp_path / "installed"


def run(folder: Path, installed: Path, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(installed)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    return done.stdout


@pytest.mark.parametrize(
    "program", ["actors", "deploy", "learner", "learner.evaluation", "replay", "viewer"]
)
def test_packages_of_the_working_directory_are_not_taken_for_ours(
    tmp_path: Path, installed: Path, program: str
) -> None:
    elsewhere = other_packages(tmp_path / "elsewhere", but=program.partition(".")[0])
    assert f"usage: python -m {program} " in run(elsewhere, installed, program, "--help")


def test_what_lies_beside_the_program_is_ours(tmp_path: Path, installed: Path) -> None:
    checkout = other_packages(tmp_path / "checkout", but="deploy")
    (checkout / "deploy").symlink_to(ROOT / "deploy")
    assert run(checkout, installed, "deploy", "--help") == "another common\n"
