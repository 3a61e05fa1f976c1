"""The image, built from nothing but Debian's packages, and a run of its containers.

No registry is asked. PyTorch and the rest come from where this machine's pip has them.
"""

import json
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.deploy.launched import launch
from tests.end_to_end.conftest import SMALL
from tests.paths import ROOT
from tests.patience import wait_until

MISSING = [name for name in ("buildah", "debootstrap") if shutil.which(name) is None]
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        bool(MISSING) or os.geteuid() != 0,
        reason=f"needs root, and {', '.join(MISSING) or 'its tools'}: deploy/install_test_tools.sh",
    ),
]
Buildah = Callable[..., list[str]]


def _host(folder: Path) -> Iterator[str]:
    """Flags by which a build sees how this machine finds packages."""
    paths = ["/etc/ssl/certs", "/etc/resolv.conf", *os.environ.get("PIP_FIND_LINKS", "").split()]
    yield from (f"--volume={path}:{path}:ro" for path in paths)
    settings = {"find-links": "PIP_FIND_LINKS", "cert": "PIP_CERT", "index-url": "PIP_INDEX_URL"}
    told = [f"{name} = {os.environ[key]}" for name, key in settings.items() if key in os.environ]
    (folder / "pip.conf").write_text("\n".join(["[global]", *told]))
    yield f"--volume={folder}/pip.conf:/etc/pip.conf:ro"
    if "PIP_FIND_LINKS" in os.environ:
        yield "--build-arg=TORCH_INDEX=https://pypi.org/simple"


@pytest.fixture
def buildah(tmp_path: Path) -> Buildah:
    """A command of buildah, with images and containers of its own."""
    places = ["--root", f"{tmp_path}/images", "--runroot", f"{tmp_path}/run"]
    return lambda *arguments: ["buildah", *places, "--storage-driver=vfs", *arguments]


@pytest.fixture
def container(tmp_path: Path, buildah: Buildah) -> str:
    """A container of the image, in which the learner is this machine."""
    base = tmp_path / "context" / "base"
    base.parent.mkdir()
    packages = "--include=python3,python3-venv,ca-certificates,g++"
    build = buildah("build", "--isolation=chroot", "--format=docker", "--network=host")
    create = ["--isolation=chroot", "--network=host", "--add-host=learner:127.0.0.1", "ale-robot"]
    (tmp_path / "base").write_text("FROM scratch\nCOPY base /\n")
    for command in (
        ["debootstrap", "--variant=minbase", packages, "bookworm", str(base)],
        [*build, "--tag=localhost/base", f"--file={tmp_path}/base", str(base.parent)],
        [
            *(*build, "--tag=localhost/ale-robot", "--build-arg=BASE=localhost/base"),
            *(*_host(tmp_path), f"--file={ROOT}/deploy/Containerfile", str(ROOT)),
        ],
    ):
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 0, f"{command}:\n{done.stdout[-4000:]}{done.stderr[-4000:]}"
    made = subprocess.run(buildah("from", *create), check=True, capture_output=True, text=True)
    return made.stdout.strip()


def test_containers_of_the_image_are_a_run(
    tmp_path: Path, buildah: Buildah, container: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = tmp_path / "runs"
    own = (f"--runs={runs}", "--run=r", "--actors=1", "--cpus=1")
    flags = ("--env=ale", "--steps=2500", *SMALL)
    launch(monkeypatch, "compose", *own, "--", *flags)
    override = json.loads((runs / "r" / "compose" / "compose.override.yaml").read_text())
    run = buildah("run", "--isolation=chroot", container, "--")
    image = buildah("inspect", "--type=image", "ale-robot")
    described = json.loads(subprocess.run(image, check=True, capture_output=True).stdout)
    _, *health = described["Docker"]["config"]["Healthcheck"]["Test"]
    user = subprocess.run([*run, "id", "--user"], check=True, capture_output=True)
    assert user.stdout.strip() == b"10001"

    with ExitStack() as stack:
        processes = {}
        for name, service in override["services"].items():
            command = [word.replace("$$", "$") for word in service["entrypoint"]]
            log = stack.enter_context((tmp_path / f"{name}.log").open("wb"))
            processes[name] = subprocess.Popen([*run, *command], stdout=log, stderr=log)
            stack.callback(processes[name].wait)
            stack.callback(processes[name].terminate)

        def healthy() -> bool:
            assert processes["learner"].poll() is None, (tmp_path / "learner.log").read_text()
            return subprocess.run([*run, *health], capture_output=True).returncode == 0

        wait_until(healthy, "the learner's container is healthy")
        assert {name: process.wait() for name, process in processes.items()} == {
            "learner": 0,
            "actor": 0,
            "evaluator": 0,
        }
    told = subprocess.run([*run, "cat", "/runs/r/summary.json"], check=True, capture_output=True)
    chunks = json.loads(told.stdout)["chunks"]
    assert chunks["made"] == chunks["acked"] > 0
