"""`python -m benchmarks.portrait -o docs/robot.png`: the robot at play, as a picture.

Left the room from outside; right what its camera sees, with the game's corners as the eye found
them, and the 84×84 frame that the network gets.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import tyro

from actors.envs.emulator import Emulator, check_game
from actors.nao.room import Room
from actors.vision.eye import Eye
from common.actions import KEYS_OF_ACTION, Keys, action_of_keys
from common.errors import InputError, exit_on_input_error

_CORNER_COLOUR = (255, 0, 255)


@dataclass(frozen=True)
class Options:
    """Let the robot play at random for a while, and take its picture."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("robot.png")
    """PNG to write."""
    game: str = "pong"
    """Any game that ale-py bundles."""
    decisions: int = 60
    """Decisions before the picture."""
    seed: int = 7
    """Of the random play."""


def main() -> int:
    options = tyro.cli(Options, prog="python -m benchmarks.portrait")
    emulator = Emulator(check_game(options.game), options.seed)
    room = Room(emulator.screen_shape)
    rng = np.random.default_rng(options.seed)
    wanted = Keys.NONE
    for decision in range(options.decisions):
        # The last command is a diagonal with fire, so that both hands are seen at work.
        last = decision == options.decisions - 1
        wanted = Keys.UP | Keys.RIGHT | Keys.FIRE if last else KEYS_OF_ACTION[rng.integers(18)]
        room.command(wanted)
        for _ in range(4):
            emulator.act(action_of_keys(room.step_frame()))
    game = emulator.screen_rgb()
    seen = room.picture(game)
    sight = Eye().see(seen)
    if sight.corners is None:
        raise InputError("the eye found no screen, so there is nothing to show.")
    outside = room.view(game, 960, 720)
    # Corners count pixel centres, and drawing doubles the picture.
    corners = np.round((sight.corners + 0.5) * 1.5 * 16 - 8).astype(np.int32)
    camera = cv2.resize(seen, (480, 360), interpolation=cv2.INTER_NEAREST)
    cv2.polylines(camera, [corners], True, _CORNER_COLOUR, 1, cv2.LINE_AA, 4)
    frame = cv2.resize(sight.frame, (360, 360), interpolation=cv2.INTER_NEAREST)
    grey = np.full((360, 480, 3), 255, np.uint8)
    grey[:, 60:420] = frame[:, :, None]
    picture = np.hstack((outside, np.vstack((camera, grey))))
    options.output.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(options.output), picture[:, :, ::-1])
    print(f"wrote {options.output}")
    room.close()
    return 0


if __name__ == "__main__":
    exit_on_input_error(main)
