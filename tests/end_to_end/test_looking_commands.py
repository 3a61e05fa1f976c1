"""`python -m viewer play` and `check` as one starts them: on what a real run has left."""

import re

import cv2
import pytest
from safetensors.numpy import load_file

from common.settings.presets import PRESETS
from tests.end_to_end.conftest import SMALL, Stage


@pytest.mark.slow
def test_what_a_run_learned_is_played_and_filmed_with_its_settings(stage: Stage) -> None:
    settings = (*SMALL, "--play.minimal-actions", "--play.max-game-frames=240")
    stage.learner("--local", "--env", "robot", "--steps", "1200", *settings).ends()
    film = stage.folder / "film.mp4"

    output = stage.start(
        *("-m", "viewer", "play", "--games", "2", "--video", str(film)),
        str(stage.run / "snapshots" / "best.safetensors"),
    ).ends()

    snapshot = load_file(stage.run / "snapshots" / "best.safetensors")
    # Quantiles of Pong's own actions, instead of 18.
    assert snapshot["actions.weight"].shape[0] == 6 * PRESETS["robot"].learning.quantiles
    steps = [int(found) for found in re.findall(r"game \d: score −?\d+ in (\d+) steps", output)]
    # 240 frames are 60 agent steps, random starts included.
    assert steps == [60, 60]
    video = cv2.VideoCapture(str(film))
    assert 60 <= video.get(cv2.CAP_PROP_FRAME_COUNT) <= 120
    assert video.get(cv2.CAP_PROP_FPS) == 15


@pytest.mark.slow
def test_check_is_green_for_this_robot(stage: Stage) -> None:
    picture = stage.folder / "check.png"
    output = stage.start("-m", "viewer", "check", "-o", str(picture)).ends()
    assert output.count("│ green │") == 4
    shown = cv2.imread(str(picture))
    assert shown is not None
    assert shown.shape == (768, 1024, 3)
