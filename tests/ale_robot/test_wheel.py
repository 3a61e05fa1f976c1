"""What the wheel holds: the product and its policies, and nothing else."""

import json
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

from tests.paths import ROOT

PACKAGES = ("actors", "ale_robot", "common", "deploy", "learner", "replay", "viewer")


def test_the_wheel_has_the_product_and_its_policies_alone(tmp_path: Path) -> None:
    # Building leaves files beside the sources.
    source = tmp_path / "source"
    for folder in (*PACKAGES, "benchmarks", "tests", "policies"):
        ignored = shutil.ignore_patterns("__pycache__", "results")
        shutil.copytree(ROOT / folder, source / folder, symlinks=True, ignore=ignored)
    for file in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / file, source)
    build = "from setuptools import build_meta; import sys; build_meta.build_wheel(sys.argv[1])"
    subprocess.run(
        [sys.executable, "-c", build, str(tmp_path)], cwd=source, check=True, capture_output=True
    )
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        card = json.loads(archive.read("ale_robot/policies/robot_pong.json"))
        (scripts,) = (archive.read(name) for name in names if name.endswith("entry_points.txt"))
    assert card["config"]["game"] == "pong"
    assert b"ale-robot = ale_robot.__main__:main" in scripts
    folders = {name.split("/")[0] for name in names if ".dist-info/" not in name}
    assert folders == set(PACKAGES)
    assert {f"{package}/py.typed" for package in PACKAGES} <= names
    modules = {name for name in names if name.endswith(".py")}
    assert modules == {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
    }
    assert "ale_robot/policies/robot_pong.safetensors" in names
    assert {"deploy/certificates.sh", "deploy/slurm/job.sh"} <= names
    assert "learner/telemetry/web/page/index.html" in names
    code = {path.name for path in (ROOT / "common" / "native").iterdir()} - {"__pycache__"}
    assert {f"common/native/{name}" for name in code} <= names
