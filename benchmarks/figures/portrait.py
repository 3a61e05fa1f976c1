"""`python -m benchmarks.figures.portrait -o docs/robot.png`: the robot at play, as a picture.

The upper row shows the room, and the robot from the front. The lower row shows what its camera
sees, with the detected corners of the game, and the 84×84 frame that the network gets.
"""

import sys
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import tyro
from numpy.typing import NDArray

from actors.envs.robot import RobotEnv
from common.actions import Keys, action_of_keys
from common.checked import Count, FromOne
from common.command_line.parser import parse
from common.errors import InputError
from common.process.program_end import exit_on_input_error
from common.settings.conditions import DEFAULT_PLAY
from viewer import overlay
from viewer.picture import write_picture

_WIDTH, _HEIGHT = 640, 480
"""Size of each panel in pixels."""


@dataclass(frozen=True)
class Options:
    """Let the robot play at random for a while, and take its picture."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("robot.png")
    """PNG file of the picture."""
    robot: str = DEFAULT_PLAY.robot
    """Robot: 'nao' or a registered one."""
    game: str = "pong"
    """Game: any that ale-py bundles."""
    steps: FromOne = 60
    """Agent steps before the picture."""
    seed: Count = 7
    """Seed of the random play."""


def main() -> int:
    options = parse(Options, "benchmarks.figures.portrait", sys.argv[1:])
    play = replace(DEFAULT_PLAY, random_starts=0, robot=options.robot)
    with closing(RobotEnv(options.game, play=play)) as env:
        env.reset(seed=options.seed)
        at_random = np.random.default_rng(options.seed).integers(18, size=options.steps - 1)
        # Ends with a diagonal and fire, so that both hands press keys.
        for action in (*at_random, action_of_keys(Keys.UP | Keys.RIGHT | Keys.FIRE)):
            env.step(action)
        picture = _portrait(env)
    write_picture(options.output, picture)
    print(f"wrote {options.output}")
    return 0


def _portrait(env: RobotEnv) -> NDArray[np.uint8]:
    """Returns the picture, ``uint8 [960, 1280, 3]``."""
    seen, detection, game = env.seen, env.detection, env.emulator.screen_rgb()
    if detection.corners is None:
        raise InputError("no screen was found in the picture: choose another --seed.")
    large = cv2.resize(seen, (_WIDTH, _HEIGHT), interpolation=cv2.INTER_NEAREST)
    camera = np.asarray(large, np.uint8)
    overlay.outline(camera, detection.corners, _WIDTH / seen.shape[1], overlay.MAGENTA)
    frame = cv2.resize(detection.frame, (_HEIGHT, _HEIGHT), interpolation=cv2.INTER_NEAREST)
    network = np.full((_HEIGHT, _WIDTH, 3), overlay.PAPER, np.uint8)
    left = (_WIDTH - _HEIGHT) // 2
    network[:, left : left + _HEIGHT] = frame[:, :, None]
    panels = (
        (env.robot.view(game, _WIDTH, _HEIGHT), "the room"),
        (env.robot.view(game, _WIDTH, _HEIGHT, "front"), "the robot, at its keys"),
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
