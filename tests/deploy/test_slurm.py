"""Runs on a real Slurm: submitted, taken away from their nodes, killed, resumed, ended."""

import json
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from benchmarks.catch import install
from common.settings.config import StreamConfig
from tests.deploy.cluster import MISSING, Cluster, cluster
from tests.end_to_end.conftest import SMALL
from tests.paths import ROOT
from tests.patience import wait_until

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        bool(MISSING),
        reason=f"{', '.join(MISSING)} are not installed: deploy/install_test_tools.sh",
    ),
]


@pytest.fixture
def slurm(tmp_path: Path) -> Iterator[Cluster]:
    with cluster(tmp_path / "cluster") as made:
        install(made.folder)
        made.environment["PYTHONPATH"] = f"{ROOT}{os.pathsep}{made.folder}"
        yield made


def launch(slurm: Cluster, steps: int, *own: str, env: str = "catch") -> Path:
    """Submits the run called r, and returns its folder once there is a checkpoint."""
    flags = ("--run=r", "--actors=2", "--submit", "--time=30", "--cpus=1", "--memory=2", *own)
    game = (f"--env={env}", f"--steps={steps}", *SMALL)
    said = slurm(sys.executable, "-m", "deploy", "slurm", *flags, "--", *game)
    assert "Submitted batch job" in said
    run = slurm.folder / "runs" / "r"
    wait_until((run / "checkpoint.safetensors").exists, f"a checkpoint in {run}")
    return run


def processes(run: Path, module: str) -> list[int]:
    """Numbers of the processes of this kind, oldest first."""
    found = []
    for entry in Path("/proc").iterdir():
        with suppress(OSError, ValueError):
            words = (entry / "cmdline").read_text().split("\0")
            if words[1:3] == ["-m", module] and str(run / "certificates") in words:
                found.append((int((entry / "stat").read_text().split()[21]), int(entry.name)))
    return [number for _, number in sorted(found)]


def agent_steps(run: Path) -> int:
    summary = run / "summary.json"
    return int(json.loads(summary.read_text())["agent_steps"]) if summary.exists() else 0


def goes_on(run: Path) -> None:
    steps = agent_steps(run)
    wait_until(lambda: agent_steps(run) > steps, f"{run} has more than {steps} steps")


def check_balance(run: Path, steps: int, lost: int = 0) -> None:
    """A run that is over has all its steps, each once, and all that was made is in.

    Args:
        lost: chunks that killed actors may have made and not handed over.
    """
    chunks = json.loads((run / "summary.json").read_text())["chunks"]
    assert agent_steps(run) >= steps
    assert chunks["excess"] == 0 < chunks["acked"]
    assert 0 <= chunks["made"] - chunks["acked"] <= lost, chunks


def test_a_learner_that_is_requeued_goes_on_and_nothing_is_lost(slurm: Cluster) -> None:
    steps = 6000
    run = launch(slurm, steps)
    assert set(slurm.states()) == {"r N/A", *(f"r-actors {task}" for task in (1, 2, 3))}
    address = (run / "address").read_text()
    assert address.startswith("tls/")

    slurm("scontrol", "requeue", slurm.job_id("r"))
    wait_until(lambda: slurm.states().get("r N/A") == "PENDING", "the learner waits its turn")
    kept = json.loads((run / "summary.json").read_text())
    assert kept["agent_steps"] < steps
    wait_until(lambda: not slurm.states(), "the run is over")

    summary = json.loads((run / "summary.json").read_text())
    assert summary["agent_steps"] >= steps
    chunks = summary["chunks"]
    assert chunks["made"] == chunks["acked"] > kept["chunks"]["acked"]
    # Each actor lived through it: what it counted since its start is what the replay has.
    assert sum(each["acked"] for each in summary["actors"]) == chunks["acked"]
    log = (run / "logs" / "learner.log").read_text()
    assert log.count("Everything is in") == 2
    assert not (run / "address").exists()
    names = {each["name"] for each in summary["actors"]}
    assert names == {"actor-1", "actor-2", "evaluator-3"}
    assert names == {*(run / "certificates" / "actors.txt").read_text().split()}


@pytest.mark.parametrize(("env", "steps"), [("catch", 6000), ("robot", 3000)])
def test_what_is_killed_starts_again(slurm: Cluster, env: str, steps: int) -> None:
    """An actor in its place; the learner's work by its parent; and that by a job in the queue.

    With -rP one reads how the run went.
    """
    run = launch(slurm, steps, env=env)
    wait_until(lambda: len(processes(run, "actors")) == 3, "actors and evaluator are there")
    actor, learner = processes(run, "actors")[0], processes(run, "learner")
    os.kill(actor, signal.SIGKILL)
    logs = run / "logs"
    wait_until(
        lambda: any("starts again" in path.read_text() for path in logs.glob("actor-*.log")),
        "the actor starts again",
    )
    os.kill(learner[1], signal.SIGKILL)
    goes_on(run)
    os.kill(learner[0], signal.SIGKILL)
    wait_until(lambda: slurm.states().get("r N/A") == "PENDING", "the learner waits its turn")
    wait_until(lambda: not slurm.states(), "the run is over")
    print((logs / "learner.log").read_text())
    check_balance(run, steps, lost=StreamConfig.window)


def test_a_replay_of_its_own_may_be_taken_away_too(slurm: Cluster) -> None:
    steps = 6000
    run = launch(slurm, steps, "--replay", "--replay-cpus=1", "--replay-memory=1")
    assert set(slurm.states()) == {
        *("r N/A", "r-learner N/A"),
        *(f"r-actors {task}" for task in (1, 2, 3)),
    }

    def is_taken_away(job: str) -> None:
        slurm("scontrol", "requeue", slurm.job_id(job))
        name = f"{job} N/A"
        wait_until(lambda: slurm.states().get(name) == "PENDING", f"{job} waits")
        wait_until(lambda: slurm.states().get(name) == "RUNNING", f"{job} is back")

    for job in ("r", "r-learner"):
        is_taken_away(job)
        goes_on(run)
    os.kill(processes(run, "replay")[1], signal.SIGKILL)
    wait_until(lambda: not slurm.states(), "the run is over")
    check_balance(run, steps)
    assert not (run / "address").exists()
