"""`python -m viewer human`: a person plays through the robot's hands, in the terminal.

The person's keys go where the agent's commands go: the arms set out for the controller's keys,
and what they press plays the game. The picture is what the robot's camera sees of the screen. So
one feels what the agent has to live with.
"""

import sys
import threading
import time
from contextlib import closing
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.envs.clock import FRAME, Deadlines
from actors.envs.game import AtariGame
from actors.envs.world import World
from actors.robots.interface import Robot
from actors.vision.layout import ASPECT, UNIT_SQUARE
from actors.vision.screen_detector import ScreenDetector
from common.actions import Keys, action_of_keys
from common.errors import InputError
from common.press_latency import COUNTS, KeyLatency
from common.registry import ENVIRONMENTS, ROBOTS
from common.run.conditions import CameraConfig
from viewer.player import Played
from viewer.terminal.half_blocks import HalfBlocks
from viewer.terminal.held_keys import HeldKeys
from viewer.terminal.terminal import Terminal

DRAW_EVERY = 4
"""Emulator frames for each picture: 15 a second."""
_LEAST_SIZE = (40, 12)
_NAMES = {Keys.UP: "↑", Keys.DOWN: "↓", Keys.LEFT: "←", Keys.RIGHT: "→", Keys.FIRE: "●"}


def keys_text(keys: Keys) -> str:
    """Keys as arrows and a dot, with gaps for those that are not held."""
    return "".join(sign if key & keys else "·" for key, sign in _NAMES.items())


@dataclass(frozen=True)
class Human(Played):
    """Play yourself through the robot's hands, in this terminal: arrow keys, space, and q."""

    def run(self, stop: threading.Event) -> int:
        """Play until the person leaves; returns the exit status.

        Raises:
            InputError: standard input or output is no terminal, or it is too small; no such game,
                or one without a robot.
        """
        config = self.config()
        if not ENVIRONMENTS.find(config.env).robot:
            raise InputError(f"a person plays through a robot's hands: omit --env {config.env}.")
        if not (sys.stdin.isatty() and sys.stdout.isatty()):
            raise InputError("a person needs a terminal for keys and picture: run it in one.")
        console = AtariGame(config.game, config.play, training=False)
        robot: Robot = ROBOTS.make(
            config.play.robot, console.emulator.screen_shape, CameraConfig(), config.play
        )
        with closing(robot), Terminal() as terminal:
            terminal.check(_LEAST_SIZE)
            world = World(robot, ROBOTS.find(config.play.robot).joints, console, config.play)
            seat = _Seat(terminal, console, robot, world)
            scores = seat.play(np.random.default_rng(config.seed), stop)
        for number, score in enumerate(scores, 1):
            print(f"game {number}: score {score:g}")
        return 0


class _Seat:
    """A person's place: keyboard and screen on one side, the robot on the other."""

    def __init__(self, terminal: Terminal, console: AtariGame, robot: Robot, world: World) -> None:
        self._terminal = terminal
        self._console = console
        self._robot = robot
        self._world = world
        self._detector = ScreenDetector()
        self._keys = HeldKeys()
        self._key_times = [0] * COUNTS
        self._size = (0, 0)
        self._late = 0
        self._blocks = HalfBlocks(1, 1)

    def play(self, rng: np.random.Generator, stop: threading.Event) -> list[float]:
        """Play game after game, in real time, until ``stop`` or the person's wish; returns the
        scores of those that ended."""
        scores = []
        self._console.begin_episode(rng, seeded=True, new_game=True)
        self._world.restart()
        deadlines = Deadlines(FRAME, time.monotonic)
        frame = 0
        while not (stop.is_set() or self._keys.wants_out):
            if (delay := deadlines.delay()) > 0:
                time.sleep(delay)
            self._late += deadlines.meet()
            agent_step = self._frame()
            if agent_step and self._console.over:
                scores.append(self._console.score)
                self._console.begin_episode(rng, seeded=False, new_game=True)
                self._world.restart()
                deadlines.restart()
            frame += 1
            # A late frame is made up for before anything is drawn.
            if frame % DRAW_EVERY == 0 and deadlines.delay() > -DRAW_EVERY * FRAME:
                self._draw()
        return scores

    def _frame(self) -> bool:
        """Pass one emulator frame under the person's keys; whether an agent step ended with it."""
        now = time.monotonic()
        self._keys.feed(self._terminal.keys(), now)
        wanted = self._keys.held(now)
        if wanted != self._world.wanted:
            self._world.command(action_of_keys(wanted))
        return self._world.frame() is not None

    def _latency(self) -> str:
        """Half of the commands, and 99 %, had their keys pressed within these times."""
        for place in self._world.key_watch.take():
            self._key_times[place] += 1
        press = KeyLatency.of(self._key_times, "press")
        if press.p50 is None:
            return "latency –"
        return f"latency {press.p50:.0f} ms (p99 {press.p99:.0f})"

    def _draw(self) -> None:
        size = self._terminal.size
        text = ""
        if size != self._size:
            self._size = size
            self._blocks = HalfBlocks(size[0], max(size[1] - 2, 1))
            text = "\x1b[0m\x1b[2J"
        seen = self._robot.camera_picture(self._console.emulator.screen_rgb())
        detection = self._detector.detect(seen)
        picture = seen if detection.corners is None else _game_in(seen, detection.corners)
        text += self._blocks.draw(picture, aspect=ASPECT)
        lines = (
            f"you {keys_text(self._world.wanted)}  keys {keys_text(self._world.pressed)}  "
            f"{self._latency()}  score {self._console.score:g}",
            f"arrows and space play, q leaves  {self._console.emulator.game}"
            f"{'' if detection.valid else '  SCREEN NOT SEEN'}"
            f"{f'  {self._late} frames late' if self._late else ''}",
        )
        for row, line in enumerate(lines, size[1] - 1):
            text += f"\x1b[{row};1H{line[: size[0] - 1]}\x1b[K"
        self._terminal.write(text)


def _game_in(seen: NDArray[np.uint8], corners: NDArray[np.float32]) -> NDArray[np.uint8]:
    """The game unwarped from the camera's picture, in colour, ``uint8 [240, 320, 3]``."""
    height, width = seen.shape[:2]
    # Pixel centres lie at whole numbers.
    edges = UNIT_SQUARE * np.array([width, height], np.float32) - np.float32(0.5)
    homography = cv2.getPerspectiveTransform(corners, edges)
    return np.asarray(cv2.warpPerspective(seen, homography, (width, height)), np.uint8)
