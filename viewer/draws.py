"""`python -m viewer draws`: shows games under drawn conditions side by side, as the robot sees
them."""

import threading
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import tyro
from numpy.typing import NDArray

from actors.envs.game_env import GameEnv
from actors.envs.observation import frames_and_vector
from actors.envs.robot import RobotEnv
from actors.envs.shown_env import ShownEnv
from actors.vision.layout import border_of
from common.checked import FromOne
from common.command_line.played import Played
from common.errors import InputError
from common.settings.conditions import Conditions
from common.settings.config import RunConfig
from common.settings.ranges import RandomiseConfig, all_ranges
from viewer import overlay
from viewer.picture import check_picture, write_picture
from viewer.player import shown_env

_WIDTH, _HEIGHT = 480, 360
"""Size of the picture of one game, pixels."""
_LINE = 17
"""Height of a line of text, pixels."""
_COLUMNS = 4
_STEPS = 12
"""Random agent steps in each game before its picture."""


@dataclass(frozen=True)
class Draws(Played):
    """Draw the conditions of games as a run with --randomise does, and write a picture of each
    game as it is seen, with the network's newest frame in a corner.

    The first game has the usual conditions. All ranges are the published ones, except for those
    given here.
    """

    randomise: RandomiseConfig = field(default_factory=RandomiseConfig)
    count: FromOne = 12
    """Number of games."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FILE.png")] = Path("draws.png")
    """File of the picture."""

    @classmethod
    def usual(cls, config: RunConfig) -> RunConfig:
        return replace(config, randomise=all_ranges(config.env))

    def check(self) -> None:
        self.config()
        check_picture(self.output)

    def run(self, stop: threading.Event) -> None:
        """Writes the picture. Raises InputError if the command was stopped before any game."""
        drawn = self.config()
        tiles = [*games(drawn.for_play, 1, stop), *games(drawn, self.count - 1, stop)]
        if not tiles:
            raise InputError("the command was stopped before any game: run it again.")
        write_picture(self.output, sheet(tiles))
        print(f"wrote {self.output}")


def games(config: RunConfig, count: int, stop: threading.Event) -> list[NDArray[np.uint8]]:
    """Returns a tile for each of ``count`` games, fewer if ``stop`` is set."""
    tiles: list[NDArray[np.uint8]] = []
    with shown_env(config) as env:
        for number in range(count):
            if stop.is_set():
                break
            observation, _ = env.reset(seed=config.seed * 1_000 + number)
            env.action_space.seed(number)
            for _ in range(_STEPS):
                observation, _, terminated, truncated, _ = env.step(env.action_space.sample())
                if terminated or truncated:
                    break
            tiles.append(tile(env, frames_and_vector(observation)[0][-1]))
    return tiles


def tile(env: ShownEnv[Any, Any], frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Returns a picture of a game, ``uint8 [rows, columns, 3]``; below are its conditions, which
    environments of other packages do not tell."""
    small = cv2.cvtColor(frame, cv2.COLOR_GRAY2RGB)
    if isinstance(env, RobotEnv):
        seen = cv2.resize(env.seen, (_WIDTH, _HEIGHT), interpolation=cv2.INTER_NEAREST)
        picture = np.asarray(seen, np.uint8)
        if env.detection.corners is not None:
            colour = overlay.MAGENTA if env.detection.valid else overlay.RED
            border = border_of(env.detection.corners)
            overlay.outline(picture, border, _WIDTH / env.seen.shape[1], colour)
        picture[-len(small) :, : small.shape[1]] = small
    else:
        large = cv2.resize(small, (_HEIGHT, _HEIGHT), interpolation=cv2.INTER_NEAREST)
        picture = np.full((_HEIGHT, _WIDTH, 3), overlay.PAPER, np.uint8)
        picture[:, (_WIDTH - _HEIGHT) // 2 :][:, :_HEIGHT] = large
    lines = told(env.conditions) if isinstance(env, GameEnv) else []
    text = np.full((_LINE * len(lines) + 8, _WIDTH, 3), overlay.PAPER, np.uint8)
    for number, line in enumerate(lines, start=1):
        overlay.write(text, line, (6, _LINE * number), size=0.42)
    return np.vstack((picture, text))


def told(conditions: Conditions) -> list[str]:
    """Returns the conditions in four lines of text."""
    play, camera, _ = conditions
    return [
        f"latency {play.actuation_latency} frames, jitter {play.actuation_jitter}, "
        f"arm x{play.arm_speed:.2f}, keys x{play.key_threshold:.2f}, sticky {play.sticky:.2f}",
        f"picture {camera.latency} steps late, {camera.dropped:.0%} lost, "
        f"noise {camera.noise:.1f}, blur {camera.blur:.1f}, gamma {camera.gamma:.2f}",
        f"light x{camera.brightness:.2f}, colours x{camera.red:.2f} {camera.green:.2f} "
        f"{camera.blue:.2f}, ambient {camera.ambient:.2f}, glare {camera.glare:.2f}",
        f"lens {camera.distortion:.3f}, head {camera.yaw:+.1f} {camera.pitch:+.1f} deg, "
        f"screen x{camera.screen_distance:.2f}, tilt {camera.screen_tilt:+.1f} deg",
    ]


def sheet(tiles: list[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Returns tiles of one size in rows of four, ``uint8 [rows, columns, 3]``."""
    columns = min(_COLUMNS, len(tiles))
    empty = [np.zeros_like(tiles[0])] * (-len(tiles) % columns)
    every = tiles + empty
    rows = [np.hstack(every[start : start + columns]) for start in range(0, len(every), columns)]
    return np.vstack(rows)
