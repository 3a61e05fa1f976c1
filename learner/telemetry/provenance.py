"""The provenance of a run's figures: versions of packages, the commit, the machine.

A figure without its provenance can neither be compared nor reproduced.
"""

import os
import platform
import re
import subprocess
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from common.process.cores import usable_cores


@cache
def provenance() -> Mapping[str, Any]:
    """Returns versions, commit and machine of this process, under the keys of ``summary.json``, as
    they were at its first call.

    - ``git_commit``: commit of the checkout that this code runs from; None outside a checkout.
    - ``git_dirty``: whether tracked files differ from that commit.
    - ``memory_bytes``: physical memory.
    - ``cores``: logical cores that this process may use.
    - ``gpus``: NVIDIA's GPUs, used or not.

    Call it at the start, too: the checkout may change under a running program.
    """
    commit, dirty = git_state(Path(__file__))
    return {
        "versions": package_versions(),
        "git_commit": commit,
        "git_dirty": dirty,
        "machine": {
            "system": f"{platform.system()} {platform.release()} {platform.machine()}",
            "cpu": _cpu_model(),
            "cores": usable_cores(),
            "memory_bytes": os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"),
            "gpus": gpu_models(),
        },
    }


def gpu_models(driver: Path = Path("/proc/driver/nvidia/gpus")) -> list[str]:
    """Returns the models of the GPUs that NVIDIA's driver lists."""
    told = (
        file.read_text(encoding="utf-8", errors="replace")
        for file in sorted(driver.glob("*/information"))
    )
    return [found[1] for each in told if (found := re.search(r"^Model:\s*(.+)$", each, re.M))]


def machine_line(machine: Mapping[str, Any]) -> str:
    """Returns processor, cores and GPUs of ``machine`` in one line for people.

    Args:
        machine: as in `provenance`, or in a file that it was written to.
    """
    return ", ".join((f"{machine['cpu']}", f"{machine['cores']} cores", *machine.get("gpus", ())))


def package_versions() -> dict[str, str | None]:
    """Returns the versions of ``python``, of this distribution and of its dependencies; None for
    what is not installed."""
    versions: dict[str, str | None] = {"python": platform.python_version()}
    packages = ["ale-robot"]
    with suppress(metadata.PackageNotFoundError):  # a checkout without `pip`
        required = metadata.requires("ale-robot") or []
        packages += [re.split(r"[^\w.-]", each)[0] for each in required if "extra ==" not in each]
    for package in packages:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = None
    return versions


def git_state(file: Path) -> tuple[str | None, bool | None]:
    """Returns the commit of the checkout of ``file``, and whether tracked files were changed.

    The file itself has to be tracked: a copy that is installed inside another checkout, for example
    in its ``.venv``, does not come from that checkout's commit.
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
    """Returns git's output in ``folder``; None without git or a checkout, or if git is too slow."""
    # In a git hook, GIT_DIR would point git at the hook's repository.
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


def _cpu_model() -> str | None:
    told = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    found = re.search(r"^model name\s*:\s*(.+)$", told, re.MULTILINE)
    return found[1] if found else platform.processor() or None
