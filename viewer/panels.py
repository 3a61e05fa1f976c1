"""A snapshot as one picture of four panels: the room, the robot's camera with what was found in it,
what the network gets, and the controller, with keys, Q-values, score and step drawn in."""

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.vision.layout import GAME_IN_PICTURE
from viewer import overlay
from viewer.snapshot import RobotSnapshot, Snapshot

PANEL = (512, 384)
"""Width and height of each of the four."""
_INPUT = 336
"""Edge of the enlarged input: four pixels for each."""
_UNIT_SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)


def draw_panels(snapshot: Snapshot) -> NDArray[np.uint8]:
    """The picture, ``uint8 [768, 1024, 3]``; of an emulator alone ``[384, 1024, 3]``."""
    network = _network_panel(snapshot)
    if snapshot.robot is None:
        return np.hstack((_screen_panel(snapshot), network))
    above = np.hstack((_outside_panel(snapshot.robot), _camera_panel(snapshot.robot)))
    below = np.hstack((_controller_panel(snapshot, snapshot.robot), network))
    picture = np.vstack((above, below))
    width, height = PANEL
    picture[:, width - 2 : width + 2] = overlay.PAPER
    picture[height - 2 : height + 2] = overlay.PAPER
    return picture


def border_of(corners: NDArray[np.float32]) -> NDArray[np.float32]:
    """Corners of the whole projected picture from those of the game in it, ``float32 [4, 2]``."""
    homography = cv2.getPerspectiveTransform(GAME_IN_PICTURE, corners)
    return np.asarray(cv2.perspectiveTransform(_UNIT_SQUARE[None], homography)[0], np.float32)


def _outside_panel(robot: RobotSnapshot) -> NDArray[np.uint8]:
    panel = _fitted(robot.outside)
    overlay.caption(panel, "room")
    return panel


def _camera_panel(robot: RobotSnapshot) -> NDArray[np.uint8]:
    width, height = PANEL
    panel = np.asarray(
        cv2.resize(robot.camera, (width, height), interpolation=cv2.INTER_NEAREST), np.uint8
    )
    if robot.corners is not None:
        # Corners count pixel centres.
        scale = np.array([width / robot.camera.shape[1], height / robot.camera.shape[0]])
        for corners, colour in (
            (border_of(robot.corners), overlay.YELLOW),
            (robot.corners, overlay.MAGENTA),
        ):
            drawn = (corners + 0.5) * scale - 0.5
            overlay.outline(panel, drawn.astype(np.float32), colour)
    if robot.found:
        overlay.caption(panel, "camera: border and game found")
    else:
        overlay.caption(panel, "camera: screen NOT found", overlay.RED)
    return panel


def _controller_panel(snapshot: Snapshot, robot: RobotSnapshot) -> NDArray[np.uint8]:
    panel = _fitted(robot.controller)
    overlay.caption(panel, "controller (filled: pressed, ring: commanded)")
    width = panel.shape[1]
    panel[8:80, width - 128 : width - 8] = overlay.PAPER
    overlay.controller_keys(panel, (width - 68, 44), 62, snapshot.wanted, snapshot.pressed)
    return panel


def _network_panel(snapshot: Snapshot) -> NDArray[np.uint8]:
    width, height = PANEL
    panel = np.full((height, width, 3), overlay.PAPER, np.uint8)
    large = cv2.resize(snapshot.frame, (_INPUT, _INPUT), interpolation=cv2.INTER_NEAREST)
    panel[8 : 8 + _INPUT, 8 : 8 + _INPUT] = large[:, :, None]
    overlay.caption(panel, "network's input, 84 x 84")
    left = _INPUT + 20
    overlay.write(panel, snapshot.game.replace("_", " ").upper()[:16], (left, 24), size=0.5)
    overlay.write(panel, f"score {snapshot.score:g}", (left, 48), size=0.5)
    overlay.write(panel, f"step  {snapshot.step}", (left, 70), size=0.5)
    heading = "random play" if snapshot.values is None else "Q-values"
    overlay.write(panel, heading, (left, 98), colour=overlay.GREY)
    area = (left, 104, width - left - 6, height - 108)
    overlay.action_values(panel, area, snapshot.actions, snapshot.chosen, snapshot.values)
    return panel


def _screen_panel(snapshot: Snapshot) -> NDArray[np.uint8]:
    """The emulator's screen, as wide as a television shows it."""
    panel = _fitted(snapshot.screen)
    overlay.caption(panel, "emulator")
    return panel


def _fitted(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A copy of ``picture`` at the panel's size."""
    if picture.shape[1::-1] == PANEL:
        return picture.copy()
    return np.asarray(cv2.resize(picture, PANEL, interpolation=cv2.INTER_LINEAR), np.uint8)
