"""A whole run by the commands that containers get, as processes of this machine."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.child import free_endpoint
from tests.deploy.launched import COMMANDS, Commands, launch_replay
from tests.end_to_end.conftest import SMALL
from tests.http_get import get
from tests.paths import ROOT
from tests.patience import PATIENCE, wait_until

POD = "actors-0"
"""The actor's."""


class Containers:
    """Processes of this machine by the commands of containers, each in a folder of its own.

    What the engine would give a container is put into its command: volumes, certificates, names of
    hosts, and ports that no other container has.
    """

    def __init__(self, commands: Commands, folder: Path, *, compose: bool) -> None:
        self._commands, self._folder, self._compose = commands, folder, compose
        self._hub = free_endpoint().partition("/")[2]
        self._pages = {name: free_endpoint().partition("/")[2] for name in commands}
        self._processes: list[subprocess.Popen[bytes]] = []

    def volume(self, name: str) -> Path:
        return self._folder / ("volume" if self._compose else f"volume-of-{name}")

    def start(self, name: str) -> subprocess.Popen[bytes]:
        places = {
            "/runs": str(self.volume(name)),
            "/certificates": str(self._folder / f"certificates-of-{name}"),
            "0.0.0.0:7447": self._hub,
            "replay:7447": self._hub,
            "0.0.0.0:9108": self._pages[name],
            "127.0.0.1:9108": self._pages[name],
            "$(POD_NAME)": POD,
        }
        found = re.compile("|".join(map(re.escape, places)))
        command = [found.sub(lambda at: places[at[0]], word) for word in self._commands[name]]
        if name != "replay" or not self._compose:
            command = _of_this_python(command)
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        with (self._folder / f"{name}.log").open("ab") as log:
            process = subprocess.Popen(
                command,
                stdout=log,
                stderr=log,
                cwd=self._folder,
                env=os.environ | {"PATH": path, "PYTHONPATH": str(ROOT)},
            )
        self._processes.append(process)
        return process

    def log(self, name: str) -> str:
        return (self._folder / f"{name}.log").read_text(errors="replace")

    def page(self, name: str, path: str) -> tuple[int, str]:
        return get(self._pages[name], path)

    def close(self) -> None:
        for process in self._processes:
            process.kill()
            process.wait()


def _of_this_python(command: list[str]) -> list[str]:
    """Returns the program that a command becomes, by way of its shell if it has one."""
    if command[0] == "sh":
        shown = [*command[:2], command[2].replace("exec ", "printf '%s\\n' ")]
        command = subprocess.check_output(shown, text=True).splitlines()
    assert command[:2] == ["python3", "-m"]
    return [sys.executable, *command[1:]]


@pytest.mark.usefixtures("forks")
@pytest.mark.parametrize("engine", COMMANDS)
def test_the_commands_are_a_run_and_its_replay_may_die(
    engine: str,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    request: pytest.FixtureRequest,
) -> None:
    """Compose's replay, which loads no PyTorch, is started as by an engine, others forked."""
    flags = ("--env=ale", "--steps=300", *SMALL)  # over before a test, which wants an evaluator
    place = launch_replay(monkeypatch, engine, tmp_path / "runs", *flags)
    containers = Containers(COMMANDS[engine](place), tmp_path, compose=engine == "compose")
    request.addfinalizer(containers.close)
    if engine == "kubernetes":
        owners = {"hub": "replay", "learner": "learner", "actor": "actor"}
        for each in json.loads((place / "kustomization.yaml").read_text())["secretGenerator"]:
            own = tmp_path / f"certificates-of-{owners[each['name']]}"
            own.mkdir()
            for file in each["files"]:
                name = Path(file).name
                if name.startswith("actor.") and POD not in name:
                    continue  # no other pod's are in its place
                shutil.copy(place / file, own / name.replace(f".{POD}", ""))
    # The learner waits: nobody has to start them in order.
    learner = containers.start("learner")
    wait_until(lambda: "waiting for a run" in containers.log("learner"), "the learner waits")
    replay, actor = containers.start("replay"), containers.start("actor")

    def stored() -> int:
        return int(
            (re.findall(r"([\d,]+) stored", containers.log("replay")) or ["0"])[-1].replace(",", "")
        )

    wait_until(lambda: stored() > 0, "steps flow")
    assert containers.page("replay", "/healthz") == (200, "ok\n")
    replay.send_signal(signal.SIGKILL)
    replay.wait()
    replay = containers.start("replay")
    assert learner.wait(PATIENCE) == 0, containers.log("learner")
    assert actor.wait(PATIENCE) == 0, containers.log("actor")
    assert replay.poll() is None, containers.log("replay")
    summary = json.loads((containers.volume("learner") / "r/summary.json").read_text())
    assert summary["updates"] > 0
    assert summary["stored"] >= 300
    assert summary["chunks"]["made"] == summary["chunks"]["acked"] > 0
    assert (containers.volume("replay") / "r/replay").is_dir()
    # What is started again goes on: it has all steps that it was asked for.
    again = containers.start("learner")
    assert again.wait(PATIENCE) == 0, containers.log("learner")
    replay.terminate()
    assert replay.wait(PATIENCE) == 0
