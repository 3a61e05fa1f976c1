"""`python -m actors --human`: a person plays through the robot's hands, in the terminal.

The person's keys go where the agent's commands go: the arms set out for the controller's keys,
and what they press plays the game. The picture is what the robot's camera sees of the screen. So
one feels what the agent has to live with.
"""

import sys
import threading
import time
from collections import deque

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.envs.clock import FRAME, Deadlines
from actors.envs.game import AtariGame
from actors.envs.world import World
from actors.robots.interface import Robot
from actors.vision.layout import ASPECT
from actors.vision.screen_detector import ScreenDetector
from common.actions import Keys, action_of_keys
from common.errors import InputError
from common.registry import ENVIRONMENTS, ROBOTS
from common.run.config import CameraConfig, RunConfig
from viewer.terminal.half_blocks import HalfBlocks
from viewer.terminal.held_keys import HeldKeys
from viewer.terminal.terminal import Terminal

DRAW_EVERY = 4
"""Emulator frames for each picture: 15 a second."""
_LEAST_SIZE = (40, 12)
_NAMES = {Keys.UP: "↑", Keys.DOWN: "↓", Keys.LEFT: "←", Keys.RIGHT: "→", Keys.FIRE: "●"}


class Reaction:
    """How long the hands take: from a new command until the keys are as commanded."""

    def __init__(self) -> None:
        self.last: int | None = None
        """Frames of the last command that was fulfilled."""
        self._recent: deque[int] = deque(maxlen=50)
        self._wanted = Keys.NONE
        self._since: int | None = None

    def frame(self, wanted: Keys, pressed: Keys) -> None:
        """Count a frame with what was wanted in it and pressed at its end."""
        if wanted != self._wanted:
            self._wanted, self._since = wanted, 0
        if self._since is None:
            return
        self._since += 1
        if pressed == wanted:
            self.last, self._since = self._since, None
            self._recent.append(self.last)

    def __str__(self) -> str:
        if self.last is None:
            return "latency –"
        median = float(np.median(self._recent))
        return f"latency {self.last * FRAME * 1000:.0f} ms (median {median * FRAME * 1000:.0f})"


def keys_text(keys: Keys) -> str:
    """Keys as arrows and a dot, with gaps for those that are not held."""
    return "".join(sign if key & keys else "·" for key, sign in _NAMES.items())


def play_by_hand(config: RunConfig, *, seed: int, stop: threading.Event) -> int:
    """Play until the person leaves; the exit status.

    Raises:
        InputError: standard input or output is no terminal, or it is too small; no such game, or
            one without a robot.
    """
    if not ENVIRONMENTS.find(config.env).robot:
        raise InputError(f"--human plays through a robot's hands: omit --env {config.env}.")
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise InputError("--human needs a terminal for its keys and its picture: run it in one.")
    console = AtariGame(config.game, config.play, training=False)
    robot: Robot = ROBOTS.make(
        config.play.robot, console.emulator.screen_shape, CameraConfig(), config.play
    )
    scores: list[float] = []
    try:
        with Terminal() as terminal:
            columns, rows = terminal.size
            if columns < _LEAST_SIZE[0] or rows < _LEAST_SIZE[1]:
                raise InputError(
                    f"the terminal has {columns} × {rows} characters: make it "
                    f"{_LEAST_SIZE[0]} × {_LEAST_SIZE[1]} or larger."
                )
            joints = ROBOTS.find(config.play.robot).joints
            world = World(robot, joints, console, config.play)
            _Seat(terminal, console, robot, world, scores).play(np.random.default_rng(seed), stop)
    finally:
        robot.close()
    for number, score in enumerate(scores, 1):
        print(f"game {number}: score {score:g}")
    return 0


class _Seat:
    """A person's place: keyboard and screen on one side, the robot on the other."""

    def __init__(
        self,
        terminal: Terminal,
        console: AtariGame,
        robot: Robot,
        world: World,
        scores: list[float],
    ) -> None:
        self._terminal = terminal
        self._console = console
        self._robot = robot
        self._world = world
        self._scores = scores
        self._detector = ScreenDetector()
        self._keys = HeldKeys()
        self._reaction = Reaction()
        self._size = (0, 0)
        self._late = 0
        self._blocks = HalfBlocks(1, 1)

    def play(self, rng: np.random.Generator, stop: threading.Event) -> None:
        """Game after game, in real time, until ``stop`` or the person's wish."""
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
                self._scores.append(self._console.score)
                self._console.begin_episode(rng, seeded=False, new_game=True)
                self._world.restart()
                deadlines.restart()
            frame += 1
            # A late frame is made up for before anything is drawn.
            if frame % DRAW_EVERY == 0 and deadlines.delay() > -DRAW_EVERY * FRAME:
                self._draw()

    def _frame(self) -> bool:
        """Pass one emulator frame under the person's keys; whether an agent step ended with it."""
        now = time.monotonic()
        self._keys.feed(self._terminal.keys(), now)
        wanted = self._keys.held(now)
        if wanted != self._world.wanted:
            self._world.command(action_of_keys(wanted))
        agent_step = self._world.frame()
        self._reaction.frame(self._world.wanted, self._world.pressed)
        return agent_step is not None

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
            f"{self._reaction}  score {self._console.score:g}",
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
    edges = np.array(
        [
            [-0.5, -0.5],
            [width - 0.5, -0.5],
            [width - 0.5, height - 0.5],
            [-0.5, height - 0.5],
        ],
        np.float32,
    )
    homography = cv2.getPerspectiveTransform(corners, edges)
    return np.asarray(cv2.warpPerspective(seen, homography, (width, height)), np.uint8)
