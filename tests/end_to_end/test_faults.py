"""Processes die by kill -9; nothing that was acknowledged is lost."""

import json
import os
import re
import shutil
import signal
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from safetensors import safe_open

from benchmarks.chaos.disk import Disk
from benchmarks.chaos.link import Link
from benchmarks.child import free_endpoint
from common.atomic_file import write_atomically
from common.run.join import find_run
from common.transport.chosen import connect
from replay.chunk_statistics import ReplayProgress
from replay.client import RemoteReplay
from tests.end_to_end.conftest import SMALL, Program, Stage
from tests.http_get import get
from tests.paths import ROOT
from tests.patience import PATIENCE, wait_until


def test_three_actors_of_which_one_is_killed(stage: Stage) -> None:
    learner = stage.learner("--env", "ale", "--steps", "1200", *SMALL)
    actors = [stage.actor(f"a{index}") for index in range(3)]
    for actor in actors:
        actor.says("plays pong")
    learner.says("a1 joined")

    actors[1].send(signal.SIGKILL)

    learner.says("a1 was lost")
    learner.ends()
    actors[0].ends()
    actors[2].ends()
    summary = stage.summary()
    chunks = summary["chunks"]
    assert chunks["made"] == chunks["acked"]
    assert chunks["refused"] == 0
    survivors = {a["name"]: a for a in summary["actors"] if a["name"] in ("a0", "a2")}
    assert all(a["made"] == a["acked"] > 0 for a in survivors.values())
    assert chunks["acked"] >= sum(a["acked"] for a in summary["actors"])


def _progress(stage: Stage) -> ReplayProgress:
    transport = connect(stage.endpoint, PATIENCE)
    remote = RemoteReplay(transport, *find_run(transport, "r", PATIENCE))
    too_late = threading.Timer(PATIENCE, remote.close)  # by itself it asks for ever
    too_late.start()
    try:
        return remote.progress(0)
    finally:
        too_late.cancel()
        transport.close()


def _is_ready(page: str) -> bool:
    return get(page, "/readyz") == (200, "ok\n")


def _figure(page: str, name: str) -> float:
    """A figure that a process tells over HTTP."""
    status, told = get(page, "/metrics")
    found = re.search(f"(?m)^{re.escape(name)} (.+)$", told)
    assert status == 200
    assert found is not None, told
    return float(found[1])


def _counts(page: str, name: str) -> bool:
    return _figure(page, name) >= 1


def _replay(stage: Stage, *arguments: str) -> None:
    stage.start("-m", "replay", "--listen", stage.endpoint, "--run", "r", *arguments)
    stage.programs[-1].says("replay of run r")


def test_a_run_has_one_learner(stage: Stage) -> None:
    """Two would each give the actors their own weights, and both say that all is well."""
    _replay(stage, "--env", "ale", *SMALL)

    def learner(runs: str) -> Program:
        far = ("--connect", stage.endpoint, "--run=r", f"--runs={runs}")
        return stage.start("-m", "learner", *far, "--threads=1", "--env=ale", *SMALL)

    first = learner("first")
    first.says("warm-up")
    assert "error: another learner trains r at tcp/" in learner("second").ends(2)
    first.send(signal.SIGKILL)
    first.process.join(PATIENCE)
    learner("second").says("warm-up")


def test_a_replay_that_is_killed_comes_back_with_everything_it_acknowledged(stage: Stage) -> None:
    pages = [free_endpoint().removeprefix("tcp/") for _ in range(2)]
    _replay(stage, "--env", "ale", "--restart=2", "--http", pages[0], *SMALL)
    replay = stage.programs[-1]
    learner = stage.start(
        "-m", "learner", "--connect", stage.endpoint, "--run", "r", "--runs", "learner-runs",
        "--threads", "1", "--http", pages[1],
        "--env", "ale", "--steps", "1500", *SMALL,
    )  # fmt: skip
    actor = stage.actor("a")
    wait_until(lambda: _progress(stage).agent_steps > 300, "the learner is learning")
    before = _progress(stage)
    acked = "ale_robot_stream_chunks_acked_total"
    played = 'ale_robot_actor_steps_total{actor="a",role="actor"}'
    for page in pages:  # the replay may have all these steps before the learner has looked around
        wait_until(partial(_is_ready, page), "it is ready")
    for page, figure in ((pages[0], acked), (pages[1], acked), (pages[1], played)):
        wait_until(partial(_counts, page, figure), f"{figure} is told")

    patient = ("--connect", stage.endpoint, f"--patience={PATIENCE}")
    status = stage.start("-m", "learner", "--status", *patient, "--json")
    told = json.loads(status.ends())
    assert (told["healthy"], told["learner"]["actors"][0]["name"]) == (True, "a")

    os.kill(replay.child, signal.SIGKILL)
    replay.says("the replay ended by signal 9")
    replay.says("restart 1 of 2 in 1 s")
    replay.says("replay of run r", 2)

    after = _progress(stage)
    assert after.accepted >= before.accepted
    assert after.agent_steps >= before.agent_steps
    assert after.statistics[: len(before.statistics)] == before.statistics
    learner.ends()
    actor.ends()
    end = _progress(stage)
    assert end.agent_steps >= 1500
    assert sum(facts.steps for facts in end.statistics) == end.agent_steps
    assert end.refused == 0


def test_two_runs_share_a_hub_and_do_not_see_each_other(stage: Stage) -> None:
    flags = ("--env=ale", *SMALL)
    for run, place in (("one", "--listen"), ("two", "--connect")):
        hub = stage.start("-m", "replay", place, stage.endpoint, "--run", run, *flags)
        hub.says(f"replay of run {run} in")
    twice = stage.start(
        *("-m", "replay", "--connect", stage.endpoint, "--run=one", "--runs=others", *flags)
    )
    assert "serves a run called one: name another" in twice.ends(2)
    lost = stage.actor("a", "--patience=0")
    assert "the hub serves several runs (one, two): name one with --run" in lost.ends(2)
    started = [
        program
        for run in ("one", "two")
        for program in (
            stage.start(
                *("-m", "learner", "--connect", stage.endpoint, "--run", run, "--threads=1"),
                *("--steps=300", *flags),
            ),
            stage.actor("a", "--run", run),  # of the same name
        )
    ]
    for program in started:
        program.ends()
    for run in ("one", "two"):
        summary = json.loads((stage.folder / "runs" / run / "summary.json").read_text())
        assert summary["agent_steps"] >= 300
        assert summary["chunks"]["made"] == summary["chunks"]["acked"] > 0
        assert summary["chunks"]["refused"] == 0
        assert len(summary["actors"]) == 1


def test_a_learner_that_is_killed_goes_on_where_it_was(stage: Stage) -> None:
    learner = stage.learner("--env", "ale", "--restart=2", "--steps=1600", *SMALL)
    actor = stage.actor("a")
    wait_until(
        lambda: (
            (stage.run / "checkpoint.safetensors").exists()
            and (stage.run / "epochs.csv").exists()
            and len(stage.rows()) >= 2
        ),
        "an epoch is complete",
    )
    before = _progress(stage)

    os.kill(learner.child, signal.SIGKILL)
    learner.says("the learner ended by signal 9")
    learner.says("restart 1 of 2 in 1 s")

    learner.ends()
    actor.ends()
    summary = stage.summary()
    assert summary["agent_steps"] >= 1600 > before.agent_steps
    assert summary["chunks"]["acked"] >= before.accepted
    assert summary["chunks"]["made"] == summary["chunks"]["acked"]
    # The same actor process lived through it: its own count is the replay's.
    (seen,) = summary["actors"]
    assert seen["made"] == seen["acked"] == summary["chunks"]["acked"]
    phases = [(row["epoch"], row["phase"]) for row in stage.rows()]
    assert len(phases) == len(set(phases))


def test_a_network_that_is_cut_costs_time_and_nothing_else(stage: Stage) -> None:
    """Longer than both sides wait for each other, and again while they find each other anew."""
    learner = stage.learner("--env", "ale", "--steps", "1000", *SMALL)
    learner.says("actors find it at")
    with Link(stage.endpoint) as link:
        far = ("--sync", "--connect", link.endpoint)
        evaluator = stage.start("-m", "actors", *far, "--name=e", "--evaluator")
        learner.says("e joined")
        actor = stage.start("-m", "actors", *far, "--name=a")
        for cuts in (1, 2):
            learner.says("a joined", cuts)
            link.cut()
            learner.says("a was lost", cuts)
            learner.says("e was lost")
            link.mend()
        learner.ends()
        actor.ends()
        evaluator.ends()
    summary = stage.summary()
    chunks = summary["chunks"]
    assert summary["agent_steps"] >= 1000
    assert chunks["made"] == chunks["acked"] > 0 == chunks["refused"]
    assert [seen["name"] for seen in summary["actors"]] == ["a", "e"]  # one process each
    epochs = [row["epoch"] for row in stage.rows() if row["phase"] == "test"]
    assert epochs == [row["epoch"] for row in stage.rows() if row["phase"] == "train"]


def test_a_link_that_only_seems_to_be_there_holds_nobody_up(stage: Stage) -> None:
    """As after a router restarts: neither side is told, and nothing arrives any more.

    The promise is 10 s; the lease is 3. The best of a few tries counts, for machines are busy.
    """
    learner = stage.learner("--env=ale", *SMALL)
    learner.says("actors find it at")
    with connect(stage.endpoint, PATIENCE) as transport, Link(stage.endpoint) as link:
        remote = RemoteReplay(transport, *find_run(transport, "r", PATIENCE))
        far = ("--sync", "--connect", link.endpoint, "--name=a")
        actor = stage.start("-m", "actors", *far)

        def seconds_until_more() -> float:
            began, before = time.monotonic(), remote.progress(0).accepted
            # More than the window of those that may have been on their way.
            wait_until(lambda: remote.progress(0).accepted > before + 4, "chunks come")
            return time.monotonic() - began

        def after_forgetting() -> float:
            link.forget()
            return seconds_until_more()

        seconds_until_more()
        assert any(after_forgetting() <= 10 for _ in range(3))

        link.forget()
        actor.send(signal.SIGSTOP)  # an old one that hangs, while somebody else takes its place
        replacement = stage.start("-m", "actors", *far)
        replacement.says("plays pong")
        assert seconds_until_more() <= 10 or any(after_forgetting() <= 10 for _ in range(2))
        learner.send(signal.SIGTERM)
        assert "go on with" in learner.ends()


def test_a_learner_without_the_steps_its_checkpoint_knows_of_says_so(stage: Stage) -> None:
    flags = ("--local", "--evaluators=0", "--env", "ale", *SMALL)
    learner = stage.learner(*flags, "--steps=300")
    learner.ends()
    known = stage.summary()["agent_steps"]  # an actor may run ahead of the goal as far as it likes
    shutil.rmtree(stage.run / "replay")

    said = stage.learner(*flags, "--resume", f"--steps={known + 500}").ends(2)

    assert known >= 300
    assert "the replay is not the one whose steps the checkpoint counts: put" in said
    network = stage.run / "checkpoint.safetensors"
    command = re.search(r"--initial (\S+)\)", said)
    assert command is not None
    assert (stage.folder / command[1]).resolve() == network
    # As it says: another run, with this one's network.
    other = ("--listen", stage.endpoint, "--run", "other", "--initial", command[1])
    stage.start("-m", "learner", *other, *flags, "--steps=300").ends()


def test_a_run_is_moved_with_its_actors(stage: Stage) -> None:
    """A copy is made while all work, and its learner takes the place of the first."""
    # A small ring goes round several times, so that rows are overwritten while they are copied.
    flags = ("--env=ale", *SMALL, "--replay.capacity=400", "--no-local")
    learner = stage.learner(*flags)
    actor = stage.actor("a", "--patience=inf")
    checkpoint = stage.run / "checkpoint.safetensors"
    wait_until(
        lambda: checkpoint.exists() and _progress(stage).agent_steps > 1_000,
        "the ring has gone round",
    )

    copy = stage.folder / "elsewhere" / "r"
    copy.parent.mkdir()
    said = stage.start("-m", "ale_robot", "backup", "runs/r", "-o", str(copy)).ends()
    assert f"ale-robot train --resume --runs {copy.parent} --run r" in said
    with safe_open(copy / "checkpoint.safetensors", "np") as saved:
        known = json.loads(saved.metadata()["state"])["books"]["agent_steps"]
    learner.send(signal.SIGKILL)
    learner.ends(-signal.SIGKILL)

    goal = known + 300
    place = ("--runs", str(copy.parent), "--listen", stage.endpoint, "--run=r", "--threads=1")
    moved = stage.start("-m", "learner", *place, *flags, "--resume", f"--steps={goal}")
    moved.ends()
    actor.ends()
    summary = json.loads((copy / "summary.json").read_text())
    assert summary["agent_steps"] >= goal
    chunks = summary["chunks"]
    # The actor lived through it. What the first learner took after the copy is not here.
    assert 0 < chunks["acked"] <= chunks["made"]
    assert chunks["refused"] == 0


@pytest.mark.parametrize("sampler", ["uniform", "prioritised"])
def test_nothing_of_a_network_that_diverged_is_kept(stage: Stage, sampler: str) -> None:
    learner = stage.learner(
        *("--local", "--evaluators=0", "--env=ale", *SMALL, "--learning.checkpoint-period=1"),
        *(f"--replay.sampler={sampler}", "--learning.learning-rate=1e30"),
    )
    said = learner.ends(2)
    assert "the loss became non-finite at update" in said
    with safe_open(stage.run / "checkpoint.safetensors", "pt") as file:
        assert all(file.get_tensor(name).isfinite().all() for name in file.keys())  # noqa: SIM118


def _on_a_full_disk(stage: Stage, free: Path, *arguments: str) -> Program:
    """The learner of a whole run, once it waits for room; ``free`` says how much there is."""
    write_atomically(free, b"0")
    learner = stage.start(
        *(str(ROOT / "tests/end_to_end/small_disk.py"), str(free), "--listen", stage.endpoint),
        *("--run=r", "--local", "--evaluators=0", "--threads=1", "--env=ale", *SMALL, *arguments),
    )
    learner.says("training waits until")
    return learner


def test_training_waits_while_the_disk_is_full(stage: Stage, tmp_path: Path) -> None:
    free = tmp_path / "free"
    learner = _on_a_full_disk(stage, free, "--steps=300")
    written = (stage.run / "checkpoint.safetensors").stat().st_mtime_ns
    assert not (stage.run / "epochs.csv").exists()
    write_atomically(free, str(2**40).encode())
    learner.says("training continues")
    learner.ends()
    assert stage.summary()["updates"] >= (300 - 200) // 4
    assert (stage.run / "checkpoint.safetensors").stat().st_mtime_ns > written


@pytest.mark.parametrize("fault", [Disk.fill, Disk.crowd, Disk.forbid])
def test_a_replay_that_finds_no_room_tries_again(
    stage: Stage, fault: Callable[[Disk], Callable[[], None]]
) -> None:
    with Disk(stage.folder / "runs", 2**28) as disk:
        if disk.missing is not None:
            pytest.skip(disk.missing)
        end = fault(disk)
        flags = ("--listen", stage.endpoint, "--run=r", *SMALL)
        assert "error: " in stage.start("-m", "replay", *flags).ends(os.EX_TEMPFAIL)
        replay = stage.start("-m", "replay", *flags, "--restart=1")
        replay.says("the replay ended by status 75")
        replay.says("another try in 1 s")
        end()
        replay.says("replay of run r")
        replay.send(signal.SIGTERM)
        replay.ends()


def test_a_run_whose_folder_is_removed_ends_with_one_sentence(stage: Stage) -> None:
    """The folder is a link to another disk, as people have it, and works like any other."""
    place = stage.folder / "elsewhere"
    place.mkdir()
    stage.run.parent.mkdir()
    stage.run.symlink_to(place)
    learner = stage.learner("--local", "--evaluators=0", "--env=ale", *SMALL)
    wait_until((place / "epochs.csv").exists, "an epoch is complete")
    place.rename(stage.folder / "removed")
    said = learner.ends(2)
    assert "error: runs/r" in said.splitlines()[-1]
    assert "Traceback" not in said


def test_a_learner_that_waits_for_room_can_be_stopped(stage: Stage, tmp_path: Path) -> None:
    learner = _on_a_full_disk(stage, tmp_path / "free")
    learner.send(signal.SIGINT)
    said = learner.ends()
    assert "go on with" in said
    assert "can be written again" not in said, "nobody made room"
