"""`make setup`: which build of PyTorch it asks for, and that pip takes it. `make train`: by which
command the run goes on."""

import os
import shlex
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.paths import ROOT
from tests.patience import PATIENCE

CPU = "--extra-index-url https://download.pytorch.org/whl/cpu"
PYTHON = f"""#!/bin/sh
case "$*" in
    "-m venv "*) mkdir -p .venv/bin; cp "$0" .venv/bin/python ;;
    "-m pip config list") exec {sys.executable} "$@" ;;
    *) echo "$*" >>calls ;;
esac
"""
TOOLS = ("cp", "grep", "mkdir", "touch")
VARIABLES = ("NAME", "ACTORS", "ARGS", "MAKEFLAGS", "MAKELEVEL")
"""Variables of an environment that would be given to make."""


def make_setup(folder: Path, environment: dict[str, str], *, gpu: bool = False) -> tuple[str, str]:
    """Runs `make setup` with a Python that installs nothing.

    Returns:
        What pip was asked to do with PyTorch, and what was printed.
    """
    for name in ("requirements.lock", "requirements-torch.lock", "pyproject.toml"):
        (folder / name).touch()
    for name in TOOLS:
        (folder / name).symlink_to(shutil.which(name) or name)
    for name, text in (("python", PYTHON), ("device", "")):
        (folder / name).write_text(text)
        (folder / name).chmod(0o755)
    make = shutil.which("make")
    assert make is not None
    done = subprocess.run(
        [
            *(make, "-f", str(ROOT / "Makefile"), "setup", "PYTHON=./python"),
            f"NVIDIA_DEVICE={folder / ('device' if gpu else 'none')}",
        ],
        cwd=folder,
        env={"PATH": str(folder), "PIP_CONFIG_FILE": os.devnull, **environment},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=True,
    )
    calls = (folder / "calls").read_text().splitlines()
    return next(call for call in calls if "-r requirements-torch.lock" in call), done.stdout


def test_without_a_gpu_the_build_for_cpu_is_fetched_and_the_way_to_another_told(
    tmp_path: Path,
) -> None:
    call, told = make_setup(tmp_path, {"PIP_DEFAULT_TIMEOUT": "60"})
    assert CPU in call
    assert "PyTorch for CPU" in told
    assert "PIP_INDEX_URL=https://pypi.org/simple make setup" in told


@pytest.mark.parametrize(
    "environment",
    [
        {"CI": "true"},
        {"PIP_INDEX_URL": "https://pypi.org/simple"},
        {"PIP_EXTRA_INDEX_URL": "https://download.pytorch.org/whl/cu130"},
        {"PIP_FIND_LINKS": "/wheels"},
        {"PIP_NO_INDEX": "1"},
    ],
    ids=lambda environment: next(iter(environment)),
)
def test_who_has_chosen_an_index_is_given_no_other(
    tmp_path: Path, environment: dict[str, str]
) -> None:
    call, told = make_setup(tmp_path, environment)
    assert CPU not in call
    assert "gigabytes if it is the CUDA build" in told


@pytest.mark.parametrize("setting", ["index-url", "extra-index-url", "find-links"])
def test_who_has_configured_an_index_is_given_no_other(tmp_path: Path, setting: str) -> None:
    config = tmp_path / "pip.conf"
    config.write_text(f"[global]\n{setting} = /wheels\n")
    assert CPU not in make_setup(tmp_path, {"PIP_CONFIG_FILE": str(config)})[0]


def test_with_a_device_of_nvidia_the_build_of_pypi_is_fetched(tmp_path: Path) -> None:
    assert CPU not in make_setup(tmp_path, {}, gpu=True)[0]


def test_with_a_driver_of_nvidia_the_build_of_pypi_is_fetched(tmp_path: Path) -> None:
    program = tmp_path / "nvidia-smi"
    program.touch(0o755)
    assert CPU not in make_setup(tmp_path, {})[0]


def index(folder: Path, version: str) -> str:
    """An index that has this version of torch, as a URL."""
    (folder / "torch").mkdir(parents=True)
    wheel = f"torch-{version}-py3-none-any.whl"
    with zipfile.ZipFile(folder / "torch" / wheel, "w") as file:
        inside = f"torch-{version}.dist-info"
        file.writestr(
            f"{inside}/METADATA", f"Metadata-Version: 2.1\nName: torch\nVersion: {version}\n"
        )
        file.writestr(f"{inside}/WHEEL", "Wheel-Version: 1.0\nTag: py3-none-any\n")
        file.writestr(f"{inside}/RECORD", "")
    (folder / "torch" / "index.html").write_text(f'<a href="{wheel}">{wheel}</a>')
    return folder.as_uri()


def test_pip_takes_the_build_for_cpu_where_pypi_has_the_same_version(tmp_path: Path) -> None:
    pypi, pytorch = index(tmp_path / "pypi", "2.13.0"), index(tmp_path / "pytorch", "2.13.0+cpu")
    subprocess.run(
        [
            *(sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "torch==2.13.0"),
            *("--index-url", pypi, "--extra-index-url", pytorch, "--dest", str(tmp_path / "got")),
        ],
        env={"PIP_CONFIG_FILE": os.devnull, "PIP_DISABLE_PIP_VERSION_CHECK": "1"},
        check=True,
        timeout=PATIENCE,
    )
    assert [file.name for file in (tmp_path / "got").iterdir()] == [
        "torch-2.13.0+cpu-py3-none-any.whl"
    ]


@pytest.mark.parametrize(
    ("given", "known"),
    [
        ([], True),
        (["NAME=other"], True),
        (["ACTORS=2", """ARGS=--seed 2 --play.env-settings 'lamps=4 "a" $$b'"""], True),
        # Where make looks for something to resume, there is nothing.
        (["ARGS=--connect tcp/h:1"], False),
        (["ARGS=--force --runs=elsewhere"], False),
        (["ARGS=--run other"], False),
    ],
    ids=str,
)
def test_a_run_is_told_the_command_that_starts_it_again(
    tmp_path: Path, given: list[str], known: bool
) -> None:
    program = tmp_path / ".venv" / "bin" / "ale-robot"
    program.parent.mkdir(parents=True)
    program.write_text('#!/bin/sh\necho "$ALE_ROBOT_AGAIN"\n')
    program.chmod(0o755)
    for name in ("requirements.lock", "requirements-torch.lock", "pyproject.toml"):
        (tmp_path / name).touch()
    (tmp_path / ".venv" / ".installed").touch()
    environment = {each: os.environ[each] for each in os.environ if each not in VARIABLES}

    def make(words: list[str]) -> str:
        command = [*words[:1], "--silent", "-f", str(ROOT / "Makefile"), *words[1:]]
        return subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
        ).stdout.strip()

    told = make(["make", "train", *given])
    assert shlex.split(told) == (["make", "train", *given] if known else [])
    assert not known or make(shlex.split(told)) == told
