"""A run on a real Ray cluster of three nodes: placed, broken, scaled, ended, gone on with."""

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from benchmarks.catch import install
from common.errors import InputError
from tests.deploy.launched import launch
from tests.end_to_end.conftest import SMALL
from tests.paths import ROOT
from tests.patience import PATIENCE, wait_until

SMALL_NODES, LARGE_NODES = 2, 6
"""Cores of the two nodes beside the head, which has one: too few on one node for a run of five
processes, and enough on either."""


def test_the_extra_that_is_missing_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    for name in ("deploy.ray_cluster", "deploy.ray_keepers"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    with pytest.raises(InputError, match=r"launch ray needs .* pip install 'ale-robot\[ray\]'"):
        launch(monkeypatch, "ray", "--run=r", f"--runs={tmp_path}")


class RayCluster:
    """A cluster that is up, and the run called r on it."""

    def __init__(self, folder: Path, cores: int, temporary: str) -> None:
        from ray.cluster_utils import Cluster

        self.folder = folder
        self.run = folder / "runs" / "r"
        small: dict[str, Any] = {"object_store_memory": 80_000_000, "include_dashboard": False}
        Path("/tmp/ray").mkdir(exist_ok=True)  # Ray writes there too, whatever its temp_dir
        self._cluster = Cluster(
            initialize_head=True, head_node_args={**small, "num_cpus": 1, "temp_dir": temporary}
        )
        for _ in range(2):
            self._cluster.add_node(num_cpus=cores, **small)
        self.address = self._cluster.address

    def close(self) -> None:
        self._cluster.shutdown()

    def command(self, *arguments: str) -> list[str]:
        """The arguments of `ale-robot launch` for this cluster."""
        own = (f"--address={self.address}", "--run=r", f"--runs={self.folder / 'runs'}")
        return ["ray", *own, "--cpus=1", "--memory=1", "--actor-memory=1", *arguments]

    def launch(self, monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
        launch(monkeypatch, *self.command(*arguments))

    def processes(self) -> dict[str, tuple[int, int]]:
        """Number and node of each process of the run, by its name; a node is that of its raylet."""
        found: dict[str, tuple[int, int]] = {}
        for entry in Path("/proc").iterdir():
            with suppress(OSError, ValueError):
                words = (entry / "cmdline").read_text().split("\0")
                if "--runs" in words and str(self.folder / "runs") in words:
                    name = words[words.index("-m") + 1]
                elif str(self.run / "certificates") in words and "--name" in words:
                    name = words[words.index("--name") + 1]
                else:
                    continue
                environment = (entry / "environ").read_text().split("\0")
                (node,) = (each for each in environment if each.startswith("RAY_RAYLET_PID="))
                found.setdefault(name, (int(entry.name), int(node.partition("=")[2])))
        return found

    def learner(self) -> int:
        """Number of the process that learns; its parent starts it again."""
        starts, _ = self.processes()["learner"]
        (found,) = Path(f"/proc/{starts}/task/{starts}/children").read_text().split()
        return int(found)

    def began(self, times: int) -> None:
        """Waits until so many learners have begun, one after the other."""
        log = self.run / "logs" / "learner.log"
        wait_until(
            lambda: log.exists() and log.read_text().count("actors find it at") == times,
            f"the learner of {self.run} begins, the {times}. time",
        )

    def goes_on(self, steps: int) -> None:
        """Waits until the run has more steps."""
        wait_until(
            lambda: (self.run / "summary.json").exists() and self.summary()["agent_steps"] > steps,
            f"{self.run} has more than {steps} steps",
        )

    def remove(self, raylet: int) -> None:
        """Has a node fail, with all that Ray has there."""
        for node in self._cluster.worker_nodes:
            if node.all_processes["raylet"][0].process.pid == raylet:
                self._cluster.remove_node(node, allow_graceful=False)
                return
        raise AssertionError(f"no node beside the head has the raylet {raylet}")

    def summary(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads((self.run / "summary.json").read_text())
        return found


@pytest.fixture
def cluster(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[RayCluster]:
    pytest.importorskip("ray", reason="Ray is not installed: pip install 'ale-robot[ray]'")
    install(tmp_path)
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}{os.pathsep}{tmp_path}")
    monkeypatch.syspath_prepend(tmp_path)  # the launcher knows the environment too
    monkeypatch.setenv("RAY_worker_niceness", "0")  # other tests would take the processor
    # The paths of its sockets must be short.
    with tempfile.TemporaryDirectory(prefix="ray-", ignore_cleanup_errors=True) as temporary:
        made = RayCluster(tmp_path, request.param, temporary)
        try:
            yield made
        finally:
            made.close()
            wait_until(lambda: not made.processes(), f"no process is left of {made.processes()}")


@pytest.mark.parametrize("cluster", [SMALL_NODES], indirect=True)
def test_a_run_is_placed_mended_scaled_ended_and_gone_on_with(
    cluster: RayCluster, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    flags = ("--", "--env=catch", *SMALL)
    cluster.launch(monkeypatch, "--actors=2", *flags)
    assert "The learner is at tls/" in capsys.readouterr().out
    wait_until((cluster.run / "checkpoint.safetensors").exists, f"a checkpoint in {cluster.run}")
    before = cluster.processes()
    assert before.keys() == {"learner", "actor-1", "actor-2", "evaluator-1"}
    assert len({node for _, node in before.values()}) > 1

    os.kill(before["actor-1"][0], signal.SIGKILL)
    with pytest.raises(InputError, match="is under way: omit the flags"):
        cluster.launch(monkeypatch, "--actors=2", *flags)
    cluster.launch(monkeypatch, "--actors=3", "--evaluators=0")
    assert "actors: 3, evaluators: 0 (1 begun, 1 ended)" in capsys.readouterr().out
    wait_until(lambda: "actor-3" in cluster.processes(), "there is another actor")
    wait_until(
        lambda: cluster.processes().get("actor-1", before["actor-1"]) != before["actor-1"],
        "the killed actor is replaced",
    )
    now = cluster.processes()
    assert "evaluator-1" not in now
    assert (now["learner"], now["actor-2"]) == (before["learner"], before["actor-2"])

    cluster.launch(monkeypatch, "--stop")
    assert "is over" in capsys.readouterr().out
    wait_until(lambda: not cluster.processes(), "no process is left")
    kept = cluster.summary()
    log = cluster.run / "logs" / "learner.log"
    assert log.read_text().count("Everything is in") == 1

    steps = f"--steps={kept['agent_steps'] + 1500}"
    command = [sys.executable, "-m", "deploy", *cluster.command("--wait", *flags, steps)]
    subprocess.run(command, check=True, cwd=cluster.folder)
    summary = cluster.summary()
    assert summary["agent_steps"] >= kept["agent_steps"] + 1500
    assert summary["chunks"]["acked"] > kept["chunks"]["acked"]
    assert log.read_text().count("Everything is in") == 2


def parent(process: int) -> int:
    (line,) = re.findall(r"(?m)^PPid:\t(\d+)$", Path(f"/proc/{process}/status").read_text())
    return int(line)


@pytest.mark.slow
@pytest.mark.parametrize("cluster", [LARGE_NODES], indirect=True)
def test_keepers_and_learner_may_be_killed_while_a_launcher_waits(cluster: RayCluster) -> None:
    flags = ("--actors=1", "--evaluators=0", "--wait", "--", "--env=catch", *SMALL)
    command = [sys.executable, "-m", "deploy", *cluster.command(*flags)]
    launcher = subprocess.Popen(command, cwd=cluster.folder, stdout=subprocess.PIPE, text=True)
    try:
        cluster.began(1)
        cluster.goes_on(0)
        for begun, name, keeper in (
            (2, "learner", True),
            (2, "actor-1", True),
            (3, "learner", False),
        ):
            steps, (process, _) = cluster.summary()["agent_steps"], cluster.processes()[name]
            os.kill(parent(process) if keeper else process, signal.SIGKILL)
            cluster.began(begun)
            cluster.goes_on(steps)
        assert launcher.poll() is None
        launcher.send_signal(signal.SIGTERM)
        told, _ = launcher.communicate(timeout=PATIENCE)
    finally:
        launcher.kill()
        launcher.wait()
    assert launcher.returncode == 0
    assert "The run r is over." in told
    cluster.began(3)


@pytest.mark.slow
@pytest.mark.parametrize("cluster", [LARGE_NODES], indirect=True)
def test_a_replay_of_its_own_and_its_learner_may_be_killed(
    cluster: RayCluster, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    own = ("--replay", "--replay-cpus=1", "--replay-memory=1", "--actors=1", "--evaluators=0")
    cluster.launch(monkeypatch, *own, "--", "--env=catch", *SMALL)
    assert "The replay is at tls/" in capsys.readouterr().out
    wait_until((cluster.run / "summary.json").exists, f"a summary in {cluster.run}")

    def is_killed(name: str) -> None:
        former, _ = cluster.processes()[name]
        os.kill(parent(former), signal.SIGKILL)
        wait_until(
            lambda: cluster.processes().get(name, (former, 0))[0] != former,
            f"the {name} is replaced",
        )

    for name in ("replay", "learner"):
        steps = cluster.summary()["agent_steps"]
        is_killed(name)
        cluster.goes_on(steps)
    # Who changes the numbers need not say again that there is a replay.
    cluster.launch(monkeypatch, "--actors=2", "--evaluators=0")
    assert "The replay is at tls/" in capsys.readouterr().out
    wait_until(lambda: "actor-2" in cluster.processes(), "there is another actor")
    cluster.launch(monkeypatch, "--stop")
    wait_until(lambda: not cluster.processes(), "no process is left")
    chunks = cluster.summary()["chunks"]
    assert chunks["made"] >= chunks["acked"] > 0


@pytest.mark.slow
@pytest.mark.parametrize("cluster", [LARGE_NODES], indirect=True)
def test_a_learner_waits_for_the_former_one_however_long_that_takes(
    cluster: RayCluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    cluster.launch(monkeypatch, "--actors=1", "--evaluators=0", "--", "--env=catch", *SMALL)
    cluster.began(1)
    cluster.goes_on(0)
    steps, log = cluster.summary()["agent_steps"], cluster.run / "logs" / "learner.log"
    former = cluster.learner()
    os.kill(former, signal.SIGSTOP)
    os.kill(parent(parent(former)), signal.SIGKILL)
    try:
        wait_until(
            lambda: "The former learner is still at work" in log.read_text(),
            "the new keeper has seen the former learner",
        )
        cluster.began(1)
    finally:
        os.kill(former, signal.SIGCONT)
    cluster.began(2)
    cluster.goes_on(steps)
    cluster.launch(monkeypatch, "--stop")


@pytest.mark.slow
@pytest.mark.parametrize("cluster", [LARGE_NODES], indirect=True)
def test_a_learner_whose_node_fails_goes_on_at_another(
    cluster: RayCluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = 6000
    cluster.launch(
        *(monkeypatch, "--actors=2", "--cpus=2", "--", "--env=catch", f"--steps={steps}", *SMALL)
    )
    wait_until((cluster.run / "checkpoint.safetensors").exists, f"a checkpoint in {cluster.run}")
    _, node = cluster.processes()["learner"]
    cluster.remove(node)
    wait_until(
        lambda: cluster.processes().get("learner", (0, node))[1] != node, "the learner is elsewhere"
    )
    assert cluster.summary()["agent_steps"] < steps
    wait_until(lambda: not cluster.processes(), "the run is over")
    summary = cluster.summary()
    assert summary["agent_steps"] >= steps
    log = (cluster.run / "logs" / "learner.log").read_text()
    assert log.count("actors find it at") == 2
