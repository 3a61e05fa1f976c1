"""`python -m viewer.portrait -o docs/robot.png`: the robot at play, as a picture.

Above the room, and the robot from the front; below what its camera sees, with the game's corners as
the detector found them, and the 84×84 frame that the network gets.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import tyro
from numpy.typing import NDArray

from actors.envs.emulator import Emulator
from actors.robots.nao.room import Room
from actors.robots.nao.viewpoint import Viewpoint
from actors.vision.screen_detector import ScreenDetector
from common.actions import KEYS_OF_ACTION, Keys, action_of_keys
from common.errors import InputError, exit_on_input_error
from common.games import check_game
from viewer import overlay

_WIDTH, _HEIGHT = 640, 480
"""Size of each panel in pixels."""
_FROM_THE_FRONT = Viewpoint((0.66, -0.32, 0.72), (0.075, 0.0, 0.272), 34.0, shadow=False)


@dataclass(frozen=True)
class Options:
    """Let the robot play at random for a while, and take its picture."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("robot.png")
    """PNG file of the picture."""
    game: str = "pong"
    """Game: any that ale-py bundles."""
    decisions: int = 60
    """Agent steps before the picture."""
    seed: int = 7
    """Seed of the random play."""


def main() -> int:
    options = tyro.cli(Options, prog="python -m viewer.portrait")
    emulator = Emulator(check_game(options.game), options.seed)
    room = Room(emulator.screen_shape)
    try:
        _play(room, emulator, options)
        picture = _portrait(room, emulator.screen_rgb())
    finally:
        room.close()
    options.output.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(options.output), picture[:, :, ::-1])
    print(f"wrote {options.output}")
    return 0


def _play(room: Room, emulator: Emulator, options: Options) -> None:
    """At random, but for the last command: a diagonal with fire, so that both hands are at work."""
    rng = np.random.default_rng(options.seed)
    commands = [KEYS_OF_ACTION[action] for action in rng.integers(18, size=options.decisions - 1)]
    for wanted in (*commands, Keys.UP | Keys.RIGHT | Keys.FIRE):
        room.command(wanted)
        for _ in range(4):
            emulator.act(action_of_keys(room.step_frame()))


def _portrait(room: Room, game: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """``uint8 [960, 1280, 3]``."""
    seen = room.picture(game)
    detection = ScreenDetector().detect(seen)
    if detection.corners is None:
        raise InputError("no screen was found in the picture: choose another --seed.")
    resized = cv2.resize(seen, (_WIDTH, _HEIGHT), interpolation=cv2.INTER_NEAREST)
    camera = np.asarray(resized, np.uint8)
    scale = _WIDTH / seen.shape[1]
    # Corners count pixel centres.
    corners = np.asarray((detection.corners + 0.5) * scale - 0.5, np.float32)
    overlay.outline(camera, corners, overlay.MAGENTA)
    frame = cv2.resize(detection.frame, (_HEIGHT, _HEIGHT), interpolation=cv2.INTER_NEAREST)
    network = np.full((_HEIGHT, _WIDTH, 3), overlay.PAPER, np.uint8)
    left = (_WIDTH - _HEIGHT) // 2
    network[:, left : left + _HEIGHT] = frame[:, :, None]
    panels = (
        (room.view(game, _WIDTH, _HEIGHT), "the room"),
        (room.view(game, _WIDTH, _HEIGHT, _FROM_THE_FRONT), "the robot, at its keys"),
        (camera, "what its camera sees, 320 x 240, and the game found in it"),
        (network, "what the network gets, 84 x 84"),
    )
    drawn = []
    for picture, caption in panels:
        panel = np.array(picture, np.uint8)
        overlay.caption(panel, caption)
        panel[:, -2:] = panel[-2:] = overlay.PAPER
        drawn.append(panel)
    return np.vstack((np.hstack(drawn[:2]), np.hstack(drawn[2:])))


if __name__ == "__main__":
    exit_on_input_error(main)
