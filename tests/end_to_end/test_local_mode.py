"""`python -m learner --local`: everything on one machine, from nothing to the files it leaves."""

import hashlib
import json
import os
import signal

import pytest
from safetensors import safe_open
from safetensors.numpy import load_file

from common.run.epochs import COLUMNS
from tests.end_to_end.conftest import SMALL, Stage
from tests.paths import ROOT
from tests.patience import wait_until

POLICIES = ROOT / "policies"


@pytest.mark.parametrize("env", ["ale", "robot"])
def test_learns_a_little_and_leaves_its_files_with_balanced_counts(stage: Stage, env: str) -> None:
    output = stage.learner("--local", "--env", env, "--steps=650", *SMALL).ends()

    summary = stage.summary()
    chunks = summary["chunks"]
    assert summary["agent_steps"] >= 650
    assert summary["updates"] >= (650 - 200) // 4
    assert summary["weights_version"] > 0
    assert chunks["made"] == chunks["acked"] + chunks["refused"]
    assert (chunks["refused"], chunks["duplicate"]) == (0, 0)
    made = {actor["role"]: actor["made"] for actor in summary["actors"]}
    assert made == {"actor": chunks["acked"], "evaluator": 0}  # a test is not learned from
    assert summary["stored"] == summary["agent_steps"]
    assert summary["valid_frame_share"] >= 0.99
    assert summary["press_match_share"] > (0.3 if env == "robot" else 0.999)
    assert summary["staleness_updates"]["p95"] is not None
    assert summary["versions"]["pybullet"]
    header = (stage.run / "epochs.csv").read_text().splitlines()[0]
    assert header == ",".join(COLUMNS)
    rows = stage.rows()
    assert [row["phase"] for row in rows[:2]] == ["random", "train"]
    trained = [row for row in rows if row["phase"] == "train"]
    tested = [row for row in rows if row["phase"] == "test"]
    # Steps that were on their way when the goal was reached may complete one more.
    assert len(trained) == len(tested) >= 2
    assert all(-21 <= float(row["average_reward"]) <= 21 for row in tested)
    assert all(int(row["steps"]) >= 100 for row in tested)
    assert float(trained[-1]["meanq"]) != 0
    assert load_file(stage.run / "snapshots" / "best.safetensors")
    assert list((stage.run / "tensorboard").iterdir())
    assert "its replay takes 0.14 GB of disk" in output  # 20,000 frames of 84 × 84
    assert "Game console created" not in output
    assert not any("A.L.E" in log.read_text() for log in (stage.run / "logs").iterdir())


def test_a_run_is_trained_and_tested_under_its_sticky_actions(stage: Stage) -> None:
    """A console that always repeats what it did before never serves a ball."""
    game = ("--env=ale", "--game=breakout", "--play.random-starts=0")
    sticky = ("--play.sticky=1", "--play.max-game-frames=200", "--protocol.test-epsilon=1")
    stage.learner("--local", *SMALL, *game, *sticky, "--steps=600").ends()
    rows = [row for row in stage.rows() if int(row["nr_games"]) > 0]
    assert {row["phase"] for row in rows} == {"random", "train", "test"}
    assert sum(int(row["nr_games"]) for row in rows) >= 10
    assert {(row["min_game_reward"], row["max_game_reward"]) for row in rows} == {("0", "0")}
    assert json.loads((stage.run / "config.json").read_text())["play"]["sticky"] == 1.0


def test_a_run_that_begins_with_a_given_network_plays_by_it_at_once(stage: Stage) -> None:
    policy = ("--initial", str(POLICIES / "ale_pong.safetensors"), "--env", "ale")
    skilled = ("--exploration.start=0", "--exploration.end=0")
    # A sixth of a game.
    short = ("--play.max-game-frames=1600", "--replay.learning-starts=450")
    own = [flag for flag in SMALL if "network" not in flag]
    alone = ("--local", "--evaluators=0")
    stage.learner(*alone, *policy, *skilled, *own, *short, "--steps=600").ends()
    # Before the first update, it was winning.
    before, after = stage.rows()[:2]
    assert (before["epoch"], before["phase"], after["epoch"]) == ("0", "train", "1")
    assert int(before["nr_games"]) >= 1
    assert float(before["average_reward"]) >= 1
    assert (stage.run / "initial.safetensors").exists()
    summary = stage.summary()
    content = (POLICIES / "ale_pong.safetensors").read_bytes()
    assert summary["initial"] == f"ale_pong#sha256={hashlib.sha256(content).hexdigest()}"
    assert summary["random_reward"] is None

    # The flags that began it go on with it, and another network is refused.
    goal = summary["agent_steps"] + 100
    stage.learner("--resume", *alone, *policy, f"--steps={goal}").ends()
    assert stage.summary()["agent_steps"] >= goal
    assert stage.summary()["initial"] == summary["initial"]
    checkpoint = str(stage.run / "checkpoint.safetensors")
    output = stage.learner("--resume", "--initial", checkpoint).ends(status=2)
    assert "did not begin with" in output
    assert "omit --initial, or name another run" in output


def test_a_given_network_that_does_not_fit_is_told_and_nothing_begun(stage: Stage) -> None:
    policy = str(POLICIES / "robot_pong.safetensors")
    output = stage.learner("--env", "robot", "--initial", policy).ends(status=2)
    assert "robot_pong.safetensors, which plays pong" in output
    assert "here it would have 0 numbers of proprioception: give --play.vector." in output
    assert not stage.run.exists()


def test_ctrl_c_ends_every_process_and_leaves_a_run_that_goes_on(stage: Stage) -> None:
    # Its actor is throttled, with a part of a chunk in each environment.
    slow = ("--envs=4", "--learning.batch-size=256", "--replay.learning-starts=300")
    learner = stage.learner("--local", "--env", "ale", *SMALL, *slow)
    wait_until(lambda: (stage.run / "epochs.csv").exists(), "the warm-up is over")
    learner.says("evaluator-1 joined")

    learner.send(signal.SIGINT)
    learner.ends()

    assert not stage.strays()
    before = stage.summary()
    assert before["chunks"]["made"] == before["chunks"]["acked"]
    with safe_open(stage.run / "checkpoint.safetensors", "np") as saved:
        worked = json.loads(saved.metadata()["state"])["seconds"]  # before its processes left
    goal = before["agent_steps"] + 150
    output = stage.learner("--local", "--resume", "--steps", str(goal)).ends()
    after = stage.summary()
    assert after["agent_steps"] >= goal
    assert after["updates"] > before["updates"]
    assert after["wall_seconds"] > worked
    assert after["chunks"]["made"] == after["chunks"]["acked"] > before["chunks"]["acked"]
    assert "warm-up 0 %" not in output


def test_a_killed_actor_is_started_again_and_none_outlives_its_learner(stage: Stage) -> None:
    stage.forks = False  # the one test whose actors are started as everybody's are
    learner = stage.learner("--local", "--evaluators=0", "--env", "robot", *SMALL)
    learner.says("actor-1 joined")
    log = stage.run / "logs" / "actor-1.log"
    wait_until(lambda: log.read_text().count("plays pong") == 1, "the actor plays")
    (actor,) = stage.strays()
    os.kill(actor, signal.SIGKILL)
    learner.says("actor-1 ended by signal 9, started again")
    wait_until(lambda: log.read_text().count("plays pong") == 2, "the actor plays again")
    assert stage.strays() != {actor}
    assert "pybullet build time" not in log.read_text()  # which its import prints

    learner.send(signal.SIGKILL)

    wait_until(lambda: not stage.strays(), "the actor has left")
