"""Draws an environment after a step as one picture of four panels.

They show the room, the robot's camera with the detected screen, the hands on the keys, and the
network's input and output.
"""

from dataclasses import KW_ONLY, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.envs.game_env import GameEnv
from actors.envs.robot import RobotEnv
from actors.envs.shown_env import ShownEnv
from actors.loop import Step
from actors.robots.nao.own_nao import OwnNao
from actors.robots.nao.robot import Nao
from actors.vision.layout import border_of
from actors.vision.screen_detector import Detection
from common.actions import Keys
from common.errors import InputError
from common.minus import points
from viewer import overlay

PANEL = (512, 384)
"""Width and height of each panel, pixels."""
_ORBIT = 26.0
"""Degrees by which an orbiting view of the room turns, to behind the robot's shoulder and back."""
_ORBIT_PICTURES = 360
"""Number of pictures in one turn and back: 24 s at 15 pictures a second."""
_INPUT = 336
"""Edge of the enlarged input, four pixels for each of its own."""


@dataclass
class Panels:
    """Draws one environment. Raises InputError if the NAO of ``nao_urdf`` cannot be shown, or if no
    NAO plays."""

    env: ShownEnv[Any, Any]
    nao_urdf: Path | None = None
    """URDF of another NAO to show in place of the one that plays, see `OwnNao`."""
    _: KW_ONLY
    room_every: int = 1
    """Number of pictures per rendering of the whole room, the slowest part; the game on its screen
    is always new."""
    orbiting: bool = False
    """Whether the view of the room turns slowly, which renders it for each picture."""

    def __post_init__(self) -> None:
        self._drawn = 0
        self._own_nao: OwnNao | None = None
        env = self.env
        if isinstance(env, RobotEnv):
            self._view = env.robot.view
        if self.nao_urdf is not None:
            if not (isinstance(env, RobotEnv) and isinstance(env.robot, Nao)):
                raise InputError("--nao-urdf shows another NAO, but no NAO plays here: omit it.")
            self._own_nao = OwnNao(self.nao_urdf, env.emulator.screen_shape)
            self._view = partial(self._own_nao.view, env.robot)

    def draw(self, step: Step, values: NDArray[np.float32] | None) -> NDArray[np.uint8]:
        """Returns the picture after ``step``, whose action was chosen by the Q-values ``values``:
        ``uint8 [768, 1024, 3]``, or ``[384, 1024, 3]`` without a robot."""
        env = self.env
        network = network_panel(env.task, step, env.actions, values)
        if not isinstance(env, RobotEnv):
            caption = "emulator" if isinstance(env, GameEnv) else "environment"
            return np.hstack((_panel(env.seen, caption), network))
        # The world stands still, or in real time it would move on from picture to picture.
        with env.still():
            screen = env.emulator.screen_rgb()
            room = _panel(self._room(screen), "room")
            camera = camera_panel(env.seen, env.detection)
            hands = hands_panel(self._view(screen, *PANEL, "hands"), env.wanted, env.pressed)
        self._drawn += 1
        picture = np.vstack((np.hstack((room, camera)), np.hstack((hands, network))))
        width, height = PANEL
        picture[:, width - 2 : width + 2] = overlay.PAPER
        picture[height - 2 : height + 2] = overlay.PAPER
        return picture

    def _room(self, screen: NDArray[np.uint8]) -> NDArray[np.uint8]:
        if self.orbiting:
            turn = _ORBIT / 2 * (np.cos(2 * np.pi * self._drawn / _ORBIT_PICTURES) - 1)
            return self._view(screen, *PANEL, "room", turn=turn)
        moved = self._drawn % self.room_every == 0
        return self._view(screen, *PANEL, "room", moved=moved)

    def close(self) -> None:
        """Closes the other NAO's rendering; the environment stays open."""
        if self._own_nao is not None:
            self._own_nao.close()


def camera_panel(seen: NDArray[np.uint8], detection: Detection) -> NDArray[np.uint8]:
    """Returns the camera's picture ``seen`` with the detected border and game."""
    panel = np.asarray(cv2.resize(seen, PANEL, interpolation=cv2.INTER_NEAREST), np.uint8)
    if detection.corners is not None:
        scale = PANEL[0] / seen.shape[1]
        overlay.outline(panel, border_of(detection.corners), scale, overlay.YELLOW)
        overlay.outline(panel, detection.corners, scale, overlay.MAGENTA)
    if not detection.valid:
        overlay.caption(panel, "camera: screen NOT found", overlay.RED)
    elif detection.corners is None:
        overlay.caption(panel, "camera: not used")
    else:
        overlay.caption(panel, "camera: border and game found")
    return panel


def hands_panel(hands: NDArray[np.uint8], wanted: Keys, pressed: Keys) -> NDArray[np.uint8]:
    """Returns the picture of the hands with the keys that are commanded and pressed."""
    panel = _panel(hands, "controller (filled: pressed, ring: commanded)")
    width = panel.shape[1]
    panel[8:80, width - 128 : width - 8] = overlay.PAPER
    overlay.controller_keys(panel, (width - 68, 44), 62, wanted, pressed)
    return panel


def network_panel(
    task: str, step: Step, actions: tuple[int | None, ...], values: NDArray[np.float32] | None
) -> NDArray[np.uint8]:
    """Returns the newest frame of the network's input, the score, and the actions' Q-values.

    Args:
        task: what is played.
        actions: ALE's numbers of the actions on offer; None for one that is not ALE's.
        values: ``float32 [actions]``; None at random play.
    """
    width, height = PANEL
    panel = np.full((height, width, 3), overlay.PAPER, np.uint8)
    large = cv2.resize(step.s_t[-1], (_INPUT, _INPUT), interpolation=cv2.INTER_NEAREST)
    panel[8 : 8 + _INPUT, 8 : 8 + _INPUT] = large[:, :, None]
    overlay.caption(panel, "network's input, 84 x 84")
    left = _INPUT + 20
    overlay.write(panel, task.replace("_", " ").upper()[:16], (left, 24))
    score = points(step.info.game_score).replace("−", "-")  # overlay writes ASCII
    overlay.write(panel, f"score {score}", (left, 48))
    overlay.write(panel, f"step  {step.info.game_steps}", (left, 70))
    heading = "random play" if values is None else "Q-values"
    overlay.write(panel, heading, (left, 98), colour=overlay.GREY)
    area = (left, 104, width - left - 6, height - 108)
    overlay.action_values(panel, area, actions, step.a_tm1, values)
    return panel


def _panel(picture: NDArray[np.uint8], caption: str) -> NDArray[np.uint8]:
    """Returns a copy of ``picture`` at the panel's size, with its caption."""
    panel = np.array(cv2.resize(picture, PANEL, interpolation=cv2.INTER_LINEAR), np.uint8)
    overlay.caption(panel, caption)
    return panel
