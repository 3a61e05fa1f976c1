"""The robot's picture, taken after a moment."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from actors.robots.nao.shapes import ORANGE
from benchmarks.figures import portrait
from common.errors import InputError
from viewer import overlay


def test_robot_screen_and_sight_are_in_the_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "new" / "robot.png"
    monkeypatch.setattr(sys, "argv", ["portrait", "-o", str(path), "--steps", "3"])
    monkeypatch.setattr(portrait, "_WIDTH", 320)
    monkeypatch.setattr(portrait, "_HEIGHT", 240)
    assert portrait.main() == 0
    written = cv2.imread(str(path))
    assert written is not None
    picture = written[:, :, ::-1].astype(int)
    assert picture.shape == (480, 640, 3)
    above, below = np.vsplit(picture, 2)
    room, front, camera, network = (*np.hsplit(above, 2), *np.hsplit(below, 2))
    # The game's own colour, on the screen; the robot's orange parts and its pressed keys.
    assert (np.abs(room - (144, 72, 17)) < 12).all(axis=2).sum() > 500
    assert (np.abs(front - np.array(ORANGE) * 200) < 60).all(axis=2).sum() > 500
    assert (np.abs(front - np.array(overlay.GREEN)) < 40).all(axis=2).sum() > 20
    assert (camera == overlay.MAGENTA).all(axis=2).sum() > 200
    # The network's frame is grey, and not of one grey.
    frame = network[:200, 40:280]
    assert (frame == frame[:, :, :1]).all()
    assert frame.std() > 10


def test_a_file_that_is_no_picture_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "robot.txt"
    monkeypatch.setattr(sys, "argv", ["portrait", "-o", str(path), "--steps", "3"])
    with pytest.raises(InputError, match=r"robot\.txt does not name a picture"):
        portrait.main()
