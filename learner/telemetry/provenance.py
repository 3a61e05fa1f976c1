"""Where a run's figures come from: versions of packages, the commit, the machine.

A figure without these cannot be compared with another, nor found again.
"""

import os
import platform
import subprocess
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Self

PACKAGES = (
    "ale-robot",
    "ale-py",
    "eclipse-zenoh",
    "gymnasium",
    "msgpack",
    "numpy",
    "opencv-python-headless",
    "pybullet",
    "pydantic",
    "rich",
    "safetensors",
    "tensorboard",
    "torch",
    "tyro",
)
"""This distribution and those it depends on, as `pyproject.toml` names them."""


@dataclass(frozen=True, kw_only=True)
class Machine:
    """The computer, as far as it bears on speed."""

    system: str
    cpu: str | None
    cores: int
    """Logical cores this process may use."""
    memory_bytes: int
    """Physical memory."""


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Gathered once, at the start, since the checkout may change under a running learner."""

    versions: dict[str, str | None]
    """Version of each of `PACKAGES` and of ``python``; None where it is not installed."""
    git_commit: str | None
    """Of the checkout this code runs from; None outside one."""
    git_dirty: bool | None
    """Tracked files differ from that commit."""
    machine: Machine

    @classmethod
    def gather(cls) -> Self:
        """What is true of this process now."""
        commit, dirty = git_state(Path(__file__))
        return cls(
            versions=package_versions(),
            git_commit=commit,
            git_dirty=dirty,
            machine=Machine(
                system=f"{platform.system()} {platform.release()} {platform.machine()}",
                cpu=_cpu_model(),
                cores=_usable_cores(),
                memory_bytes=os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"),
            ),
        )


def package_versions() -> dict[str, str | None]:
    """Version by distribution name, ``python`` first."""
    versions: dict[str, str | None] = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = None
    return versions


def git_state(file: Path) -> tuple[str | None, bool | None]:
    """Commit of the checkout to which ``file`` belongs, and whether tracked files were changed.

    The file itself has to be tracked: an installed copy inside somebody else's checkout (a
    ``.venv`` in it, say) was not made from that one's commit.
    """
    folder = file.resolve().parent
    if _git(folder, "ls-files", "--error-unmatch", file.name) is None:
        return None, None
    commit = _git(folder, "rev-parse", "--verify", "HEAD")
    if commit is None:
        return None, None
    changed = _git(folder, "status", "--porcelain", "--untracked-files=no")
    return commit, None if changed is None else changed != ""


def _git(folder: Path, *arguments: str) -> str | None:
    """What git answers in ``folder``; None without git, without a checkout, or too slow."""
    # A hook's GIT_DIR would point every git below it at the hook's repository.
    environment = {name: value for name, value in os.environ.items() if name[:4] != "GIT_"}
    try:
        answer = subprocess.run(
            ["git", "--no-optional-locks", "-C", str(folder), *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=10,
            env=environment,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return answer.stdout.strip() if answer.returncode == 0 else None


def _usable_cores() -> int:
    if hasattr(os, "sched_getaffinity"):  # not on macOS
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _cpu_model() -> str | None:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor() or None
    for line in lines:
        name, _, value = line.partition(":")
        if name.strip() == "model name":
            return value.strip()
    return platform.processor() or None
