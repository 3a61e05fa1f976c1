"""A run that begins with recorded games, in one process and in several."""

from pathlib import Path

import pytest

from common.dataset.reader import Dataset
from tests.end_to_end.conftest import SMALL, Stage
from tests.paths import ROOT

POLICY = str(ROOT / "policies" / "ale_pong.safetensors")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Half a minute of the published policy's play."""
    stage = Stage(tmp_path_factory.mktemp("recording"))
    folder = stage.folder / "d"
    record = ("-m", "viewer", "record", POLICY, "-o", str(folder), "--minutes=0.5")
    assert "wrote 1 game of 450 steps" in stage.start(*record).ends()
    return folder


def test_a_run_begins_with_them_once(stage: Stage, recording: Path) -> None:
    given = ("--local", "--evaluators=0", "--demonstrations", str(recording))
    output = stage.learner(*given, "--env=ale", "--steps=700", *SMALL).ends()
    assert f"the replay begins with 449 steps of {recording}" in output
    summary = stage.summary()
    assert summary["demonstrations"] == 449
    assert summary["updates"] >= (700 - 200) // 4
    chunks, made = summary["chunks"], {each["name"]: each for each in summary["actors"]}
    assert made["demonstrations"]["steps"] == 449
    assert made["actor-1"]["steps"] == summary["agent_steps"] - 449
    assert sum(each["made"] for each in made.values()) == chunks["made"] == chunks["acked"]
    assert (chunks["refused"], chunks["duplicate"], chunks["excess"]) == (0, 0, 0)
    # The recorded games are none of the run's own.
    assert stage.rows()[0]["phase"] == "random"
    assert stage.rows()[0]["nr_games"] == "0"

    goal = f"--steps={summary['agent_steps'] + 100}"
    resumed = stage.learner("--resume", *given, goal).ends()
    assert "the replay begins with" not in resumed  # they are there already
    after = stage.summary()
    # Only those that took part since are told, and all that is new is theirs.
    played = sum(each["steps"] for each in after["actors"])
    assert after["agent_steps"] == summary["agent_steps"] + played
    assert after["chunks"]["made"] == after["chunks"]["acked"]
    assert after["demonstrations"] == 449
    assert after["chunks"]["duplicate"] == 0
    assert "--demonstrations" not in resumed.splitlines()[-1]

    # A start that is refused changes nothing, though there is no checkpoint, as before the first.
    told = stage.run / "demonstrations.json"
    before = told.read_bytes()
    for checkpoint in stage.run.glob("checkpoint*"):
        checkpoint.unlink()
    refused = stage.learner("--local", "--env=ale", *SMALL).ends(status=2)
    assert "already holds a run" in refused
    assert told.read_bytes() == before


def test_a_replay_of_its_own_gets_them_too(stage: Stage, recording: Path) -> None:
    settings = ("--env=ale", *SMALL)
    replay = stage.start("-m", "replay", "--run=r", "--listen", stage.endpoint, *settings)
    replay.says("at tcp/")
    learner = ("-m", "learner", "--run=r", "--connect", stage.endpoint, "--threads=1")
    given = ("--demonstrations", str(recording), "--steps=300")
    # What they bring is enough: nobody else plays.
    output = stage.start(*learner, *settings, *given).ends()
    assert "the replay begins with 449 steps" in output
    assert stage.summary()["agent_steps"] == 449
    assert stage.summary()["updates"] >= 25
    assert [row["phase"] for row in stage.rows()] == ["random", "train"]  # to be tested


def test_those_that_cannot_be_used_leave_nothing(stage: Stage, recording: Path) -> None:
    given = ("--demonstrations", str(recording))
    output = stage.learner("--env=ale", "--game=breakout", *given).ends(status=2)
    _, told = output.splitlines()  # after the line that PyTorch is loaded
    assert "have game pong instead of breakout" in told
    assert "give the run --game pong, or record others" in told
    output = stage.learner("--env=ale", "--demonstrations", str(stage.folder)).ends(status=2)
    assert "holds no whole game" in output
    assert not stage.run.exists()
    assert Dataset(recording).episodes == 1
