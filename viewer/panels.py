"""A glance as one picture of four panels: the room, the robot's camera with what the eye found,
what the network gets, and the controller, with keys, Q-values, score and step drawn in."""

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.vision.layout import GAME_IN_PICTURE
from viewer import overlay as ink
from viewer.snapshot import Glance, RobotGlance

PANEL = (512, 384)
"""Width and height of each of the four."""
_INPUT = 336
"""Edge of the enlarged input: four pixels for each."""
_UNIT_SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)


def draw_panels(glance: Glance) -> NDArray[np.uint8]:
    """The picture, ``uint8 [768, 1024, 3]``; of an emulator alone ``[384, 1024, 3]``."""
    network = _network_panel(glance)
    if glance.robot is None:
        return np.hstack((_screen_panel(glance), network))
    above = np.hstack((_outside_panel(glance.robot), _camera_panel(glance.robot)))
    below = np.hstack((_controller_panel(glance, glance.robot), network))
    picture = np.vstack((above, below))
    width, height = PANEL
    picture[:, width - 2 : width + 2] = ink.PAPER
    picture[height - 2 : height + 2] = ink.PAPER
    return picture


def border_of(corners: NDArray[np.float32]) -> NDArray[np.float32]:
    """Corners of the whole projected picture from those of the game in it, ``float32 [4, 2]``."""
    homography = cv2.getPerspectiveTransform(GAME_IN_PICTURE, corners)
    return np.asarray(cv2.perspectiveTransform(_UNIT_SQUARE[None], homography)[0], np.float32)


def _outside_panel(robot: RobotGlance) -> NDArray[np.uint8]:
    panel = _fitted(robot.outside)
    ink.caption(panel, "room")
    return panel


def _camera_panel(robot: RobotGlance) -> NDArray[np.uint8]:
    width, height = PANEL
    panel = np.asarray(
        cv2.resize(robot.camera, (width, height), interpolation=cv2.INTER_NEAREST), np.uint8
    )
    if robot.corners is not None:
        # Corners count pixel centres.
        scale = np.array([width / robot.camera.shape[1], height / robot.camera.shape[0]])
        for corners, colour in (
            (border_of(robot.corners), ink.YELLOW),
            (robot.corners, ink.MAGENTA),
        ):
            drawn = (corners + 0.5) * scale - 0.5
            ink.outline(panel, drawn.astype(np.float32), colour)
    if robot.found:
        ink.caption(panel, "camera: border and game found")
    else:
        ink.caption(panel, "camera: screen NOT found", ink.RED)
    return panel


def _controller_panel(glance: Glance, robot: RobotGlance) -> NDArray[np.uint8]:
    panel = _fitted(robot.controller)
    ink.caption(panel, "controller (filled: pressed, ring: commanded)")
    width = panel.shape[1]
    panel[8:80, width - 128 : width - 8] = ink.PAPER
    ink.controller_keys(panel, (width - 68, 44), 62, glance.wanted, glance.pressed)
    return panel


def _network_panel(glance: Glance) -> NDArray[np.uint8]:
    width, height = PANEL
    panel = np.full((height, width, 3), ink.PAPER, np.uint8)
    large = cv2.resize(glance.frame, (_INPUT, _INPUT), interpolation=cv2.INTER_NEAREST)
    panel[8 : 8 + _INPUT, 8 : 8 + _INPUT] = large[:, :, None]
    ink.caption(panel, "network's input, 84 x 84")
    left = _INPUT + 20
    ink.write(panel, glance.game.replace("_", " ").upper()[:16], (left, 24), size=0.5)
    ink.write(panel, f"score {glance.score:g}", (left, 48), size=0.5)
    ink.write(panel, f"step  {glance.step}", (left, 70), size=0.5)
    heading = "random play" if glance.values is None else "Q-values"
    ink.write(panel, heading, (left, 98), colour=ink.GREY)
    area = (left, 104, width - left - 6, height - 108)
    ink.action_values(panel, area, glance.actions, glance.chosen, glance.values)
    return panel


def _screen_panel(glance: Glance) -> NDArray[np.uint8]:
    """The emulator's screen, as wide as a television shows it."""
    panel = _fitted(glance.screen)
    ink.caption(panel, "emulator")
    return panel


def _fitted(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A copy of ``picture`` at the panel's size."""
    if picture.shape[1::-1] == PANEL:
        return picture.copy()
    return np.asarray(cv2.resize(picture, PANEL, interpolation=cv2.INTER_LINEAR), np.uint8)
