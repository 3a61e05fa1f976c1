"""A run on a real Slurm: submitted, taken away from its node, resumed, ended."""

import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.catch import install
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


def test_a_learner_that_is_requeued_goes_on_and_nothing_is_lost(slurm: Cluster) -> None:
    steps = 6000
    said = slurm(
        *(
            sys.executable,
            "-m",
            "deploy",
            "slurm",
            "--run=r",
            "--actors=2",
            "--submit",
            "--time=30",
        ),
        *("--cpus=1", "--memory=2", "--"),
        *("--env=catch", f"--steps={steps}", *SMALL),
    )
    assert "Submitted batch job" in said
    run = slurm.folder / "runs" / "r"
    wait_until((run / "checkpoint.safetensors").exists, f"a checkpoint in {run}")
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
