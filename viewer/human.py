"""`python -m viewer human`: a person plays through the robot's hands, in the terminal.

The person's keys take the place of the agent's commands: the arms move to the controller's keys,
and what they press plays the game. The picture shows what the robot's camera sees of the screen,
with the hands beside it. So the person feels what the agent has to live with.
"""

import threading
import time
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import reduce
from operator import or_
from pathlib import Path
from typing import Annotated, Any

import cv2
import gymnasium
import numpy as np
import tyro
from numpy.typing import NDArray

from actors.envs import make_env
from actors.envs.robot import RobotEnv
from actors.loop import Step, play
from actors.vision.layout import ASPECT, UNIT_SQUARE
from common.actions import KEYS_OF_ACTION, Keys, action_of_keys
from common.command_line.played import Played
from common.counted import counted
from common.errors import InputError
from common.games import MINIMAL_ACTIONS
from common.minus import points
from common.press_latency import COUNTS, KeyLatency
from common.process.extras import check_extra
from common.registry import ENVIRONMENTS
from common.settings.clock import ClockConfig
from viewer.player import unfinished
from viewer.recorder import Recorder, check_new_folder
from viewer.terminal.half_blocks import HalfBlocks
from viewer.terminal.held_keys import HeldKeys
from viewer.terminal.terminal import Terminal

REAL_TIME = ClockConfig(sync=False)
_HANDS_EVERY = 3
"""Agent steps per picture of the hands. A picture takes some 15 ms, and the world waits for it."""
_LEAST_SIZE = (40, 12)
_NAMES = {Keys.UP: "↑", Keys.DOWN: "↓", Keys.LEFT: "←", Keys.RIGHT: "→", Keys.FIRE: "●"}


def keys_text(keys: Keys) -> str:
    """Returns keys as arrows and a dot, with gaps for those that are not held."""
    return "".join(sign if key & keys else "·" for key, sign in _NAMES.items())


def used_keys(game: str) -> str:
    """Returns the keys that a game uses, as keys of a keyboard."""
    used = reduce(or_, (KEYS_OF_ACTION[action] for action in MINIMAL_ACTIONS[game]))
    return " ".join("space" if key == Keys.FIRE else _NAMES[key] for key in _NAMES if key & used)


@dataclass(frozen=True)
class Human(Played):
    """Play yourself through the robot's hands: arrow keys, space and q."""

    record: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")] = None
    """Folder for a recording of your games, as `record` makes it; it must not exist yet."""

    def check(self) -> None:
        if self.record is not None:
            check_extra("a recording", "record")
            check_new_folder(self.record)

    def run(self, stop: threading.Event) -> None:
        """Plays until the person leaves.

        Raises:
            InputError: standard input or output is not a terminal, or the terminal is too small;
                there is no such game; the environment has no robot; or the recording's folder
                exists already.
        """
        config = self.config()
        if not ENVIRONMENTS.find(config.env).robot:
            raise InputError(f"a person plays through a robot's hands: omit --env {config.env}.")
        terminal = Terminal(_LEAST_SIZE)
        # In a recording, episodes end at a lost life, as those of a run's actors do.
        env = make_env(config, REAL_TIME, training=self.record is not None)
        if not isinstance(env, RobotEnv):
            env.close()
            raise InputError(f"a person cannot play --env {config.env}: omit it.")
        played: gymnasium.Env[Any, Any] = env
        recorder = None
        with closing(env), ExitStack() as end, terminal:
            if self.record is not None:
                recorder = Recorder(env, config, self.record)
                played = end.enter_context(closing(recorder))
            seat = _Seat(terminal, env)
            scores = []
            for step in play([played], seat, [config.seed]):
                if recorder is not None:
                    recorder.add(step)
                if step.info.game_over:
                    scores.append(step.info.game_score)
                if stop.is_set() or seat.keys.wants_out:
                    break
                seat.show(step)
        for number, score in enumerate(scores, 1):
            print(f"game {number}: score {points(score)}")
        if not scores:
            print(unfinished(step.info))
        if recorder is not None:
            print(recorder.summary)


class _Seat:
    """The person's seat, between keyboard and screen on one side and the robot on the other.

    It acts as a policy, so the person also gives one command for each agent step.
    """

    weights_version = 0
    epsilon = 0.0

    def __init__(self, terminal: Terminal, env: RobotEnv) -> None:
        self.explored = np.zeros(1, np.bool_)
        self._terminal = terminal
        self._env = env
        self.keys = HeldKeys()
        self._key_times = [0] * COUNTS
        self._late = 0
        self._blocks = HalfBlocks()
        self._shown = 0
        self._hands: NDArray[np.uint8] | None = None

    def act(self, frames: NDArray[np.uint8], vectors: NDArray[np.float32]) -> NDArray[np.int64]:
        """Returns the offered action that has most of the held keys, and no others; see
        `actors.loop.Player.act`."""
        now = time.monotonic()
        self.keys.feed(self._terminal.keys(), now)
        held = KEYS_OF_ACTION[action_of_keys(self.keys.held(now))]
        offered = [KEYS_OF_ACTION[action] for action in self._env.actions]
        sizes = [keys.bit_count() if keys & held == keys else -1 for keys in offered]
        return np.array([int(np.argmax(sizes))])

    def show(self, step: Step) -> None:
        """Draws what the robot sees after ``step``."""
        for place in step.info.key_times:
            self._key_times[place] += 1
        self._late += step.info.late_frames
        columns, rows = self._terminal.size
        env, seen, detection = self._env, self._env.seen, self._env.detection
        picture = seen if detection.corners is None else _game_in(seen, detection.corners)
        if self._shown % _HANDS_EVERY == 0 or self._hands is None:
            self._hands = env.view(picture.shape[1] // 2, picture.shape[0] // 2, "hands")
        self._shown += 1
        both = beside(picture, self._hands)
        text = self._blocks.draw(both, columns, max(rows - 2, 1), aspect=ASPECT * 1.5)
        lines = (
            f"you {keys_text(env.wanted)}  keys {keys_text(env.pressed)}  "
            f"{self._latency()}  score {points(step.info.game_score)}",
            f"keys of {env.emulator.game}: {used_keys(env.emulator.game)}; q leaves"
            f"{'' if detection.valid else '  SCREEN NOT SEEN'}"
            + (f"  {counted(self._late, 'frame')} late" if self._late else ""),
        )
        for row, line in enumerate(lines, rows - 1):
            text += f"\x1b[{row};1H{line[: columns - 1]}\x1b[K"
        self._terminal.write(text)

    def _latency(self) -> str:
        """Returns p50 and p99 of the time from a command to its keys, as text."""
        press = KeyLatency.of(self._key_times, "press")
        if press.p50 is None:
            return "latency –"
        return f"latency {press.p50:.0f} ms (p99 {press.p99:.0f})"


def beside(game: NDArray[np.uint8], hands: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Returns the game, ``uint8 [height, width, 3]``, with the hands at half its size to the right,
    halfway up."""
    height = hands.shape[0]
    above = (game.shape[0] - height) // 2
    margins = ((above, game.shape[0] - height - above), (0, 0), (0, 0))
    return np.hstack([game, np.pad(hands, margins)])


def _game_in(seen: NDArray[np.uint8], corners: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Returns the game, unwarped from the camera's picture, in colour, ``uint8 [240, 320, 3]``."""
    height, width = seen.shape[:2]
    # Pixel centres have whole coordinates.
    edges = UNIT_SQUARE * np.array([width, height], np.float32) - np.float32(0.5)
    homography = cv2.getPerspectiveTransform(corners, edges)
    return np.asarray(cv2.warpPerspective(seen, homography, (width, height)), np.uint8)
