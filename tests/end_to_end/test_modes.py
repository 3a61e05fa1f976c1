"""A robot's other modes of time, and its vector observation, through the whole pipeline."""

import pytest

from common.proprioception import vector_width
from common.settings.conditions import PlayConfig
from tests.end_to_end.conftest import SMALL, Stage


@pytest.mark.slow
@pytest.mark.parametrize(
    "mode",
    [
        ["--wait-action"],
        ["--no-sync", "--speed", "4"],
        ["--no-sync", "--speed", "4", "--wait-action"],
    ],
    ids=" ".join,
)
def test_a_robot_learns_in_every_mode_and_tells_how_its_time_went(
    stage: Stage, mode: list[str]
) -> None:
    output = stage.learner("--local", "--env", "robot", "--steps", "900", *SMALL, *mode).ends()

    summary = stage.summary()
    assert summary["updates"] > 0
    assert summary["chunks"]["made"] == summary["chunks"]["acked"]
    assert summary["valid_frame_share"] >= 0.99
    agent_steps = sum(actor["decisions"] for actor in summary["actors"])
    steps = sum(actor["steps"] for actor in summary["actors"])
    assert agent_steps >= steps >= 900
    assert summary["decisions_per_step"] == pytest.approx(agent_steps / steps)
    if "--no-sync" not in mode:
        assert (summary["missed_deadlines"], summary["late_frames"]) == (0, 0)
    if "--wait-action" not in mode:
        assert summary["waits_given_up"] == 0
        # One that missed a game's end has no agent step of its own; a slow machine is late.
        games = sum(int(row["nr_games"]) for row in stage.rows())
        more = games + summary["late_frames"]
        assert 0 <= steps + summary["missed_deadlines"] - agent_steps <= more
    else:
        # The keys are as commanded unless the wait was given up, or the episode ended.
        assert summary["press_match_share"] > 0.95
    last_words = output.splitlines()[-1]
    assert all(flag in last_words for flag in mode)  # with which to go on


@pytest.mark.slow
def test_vectors_go_through_replay_network_and_evaluator_and_survive_a_restart(
    stage: Stage,
) -> None:
    learner = ("--local", "--env", "robot")
    stage.learner(*learner, "--play.vector", "--steps", "1300", *SMALL).ends()
    before = stage.summary()
    stage.learner("--local", "--resume", "--steps", "1700").ends()
    after = stage.summary()
    assert after["updates"] > before["updates"]
    assert after["stored"] > before["stored"] >= 1300
    assert after["chunks"]["refused"] == 0
    assert after["test_reward"] is not None
    stored = (stage.run / "replay" / "vectors.bin").stat().st_size
    assert stored == 4 * vector_width(PlayConfig(), 8) * 20_000
