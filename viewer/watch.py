"""`ale-robot watch`: shows a trained network at play, in the terminal.

On the left is the camera's picture around the screen, with the detected screen and game; on the
right are the hands at the controller, the score, the keys and the value of each action.
"""

import math
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.envs.robot import RobotEnv
from actors.envs.shown_env import ShownEnv
from actors.loop import Step, play, seeds_of
from actors.vision.layout import ASPECT, border_of
from common.actions import KEYS_OF_ACTION
from common.checked import Count, Fraction
from common.command_line.played import Played
from common.counted import counted
from common.minus import points
from common.q_bars import q_bars
from common.run.origin import name_of, shown_weights
from common.settings.config import RunConfig
from viewer import overlay
from viewer.human import keys_text
from viewer.player import Network, ShownPolicy, shown_env, unfinished
from viewer.terminal.graphics import QUESTIONS, Graphics, GraphicsAnswers
from viewer.terminal.half_blocks import HalfBlocks
from viewer.terminal.held_keys import HeldKeys
from viewer.terminal.terminal import Terminal, check_terminal

LEAST_SIZE = (60, 20)
_SMALLEST = (3, 2)
"""Least columns and rows in which there is anything to draw, if the terminal is made smaller."""
_HANDS = (160, 120)
"""Least width and height at which the hands are rendered, pixels; small, because cells are
large."""
_LEAST_SIDE, _MAX_SIDE = 30, 66
"""Columns beside the camera's picture: as few as the texts need, so that the picture is large; more
than the maximum would not make the bars easier to read."""
_MAX_BEFORE = 5
"""Number of earlier games whose scores are shown beside the present score."""
_MARGIN = 1.4
"""Height of the shown part of the camera's picture, in heights of the screen. The rest is wall, and
the ball is small enough as it is."""
_WIDEST = 800
"""Maximum width of a picture, pixels: larger ones show no more, and some terminals refuse them."""
_BOLD, _DIM, _GOOD, _BAD, _CHOSEN = (f"\x1b[{code}m" for code in ("1", "2", "32", "1;31", "33"))
_PLAIN = "\x1b[0;38;2;214;214;214;48;2;0;0;0m"
"""Grey on black for the texts beside the pictures, whatever colours the terminal has."""


@dataclass(frozen=True)
class Watch(Played):
    """Watch a trained network play in this terminal, until q.

    It plays under the settings of its run, except for those given here.
    """

    weights: Network = None
    """Network that plays, such as robot_pong or runs/NAME/snapshots/best.safetensors; by default
    the published one of --env and --game, or random actions if there is none."""
    epsilon: Fraction = 0.001
    """Share of random actions."""
    games: Count = 0
    """Number of whole games; 0 plays until q."""

    @property
    def network(self) -> Path | None:
        return self.weights or shown_weights(self.env, self.game, self.play.robot)

    def check(self) -> None:
        self.config()
        check_terminal(LEAST_SIZE)

    def run(self, stop: threading.Event) -> None:
        """Plays until there are enough games, or the person leaves. Raises InputError if there is
        no terminal, or it is too small, or the network cannot be used."""
        config = self.config()
        policy_seed, env_seed = seeds_of(config.seed)
        network = self.network
        policy = ShownPolicy.of_file(config, network, self.epsilon, policy_seed)
        name = "chance, as no network is published," if network is None else name_of(network)
        terminal = Terminal(LEAST_SIZE)
        keys, scores = HeldKeys(), list[float]()
        with shown_env(config) as env, terminal:
            screen = WatchScreen(env, config, name, self.changes())
            answers = GraphicsAnswers()
            terminal.write(QUESTIONS)
            period, due = 1 / env.rate, time.monotonic()
            for step in play([env], policy, [env_seed]):
                terminal.write(screen.draw(terminal.size, step, policy.values, scores))
                # The pictures after a late one keep the usual pace.
                due = max(due + period * step.info.elapsed, time.monotonic())
                stop.wait(due - time.monotonic())
                sent = terminal.keys()
                keys.feed(sent, time.monotonic())
                answers.feed(sent)
                screen.graphics = answers.graphics(terminal.cell)
                if step.info.game_over:
                    scores.append(step.info.game_score)
                if stop.is_set() or keys.wants_out or 0 < self.games <= len(scores):
                    break
        for number, score in enumerate(scores, 1):
            print(f"game {number}: score {points(score)}")
        if not scores:
            print(unfinished(step.info))


class WatchScreen:
    """Lays out pictures and texts for a terminal of at least `LEAST_SIZE`."""

    def __init__(
        self, env: ShownEnv[Any, Any], config: RunConfig, name: str, changes: str = ""
    ) -> None:
        self._env = env
        self._changes = f"; other than trained: {changes}" if changes else ""
        self._name = name
        self._title = config.played.replace("_", " ")
        self.graphics: Graphics | None = None
        """How to draw pictures; None for half blocks."""
        self._drawn: Graphics | None = None
        self._blocks = HalfBlocks()

    def draw(
        self,
        size: tuple[int, int],
        step: Step,
        values: NDArray[np.float32] | None,
        scores: Sequence[float],
    ) -> str:
        """Returns what to write into a terminal of ``size`` columns and rows after ``step``.

        Less is shown in one that was made smaller than `LEAST_SIZE` in the meantime.

        Args:
            values: Q-values by which the action was chosen, ``float32 [actions]``; None at random
                play.
            scores: scores of the games that ended.
        """
        columns, rows = map(max, size, _SMALLEST)
        if self.graphics != self._drawn:
            self._drawn, self._blocks = self.graphics, HalfBlocks()
        # With half blocks, a cell has two pixels, one above the other.
        wide, high = (1, 2) if self.graphics is None else self.graphics.cell
        room = columns - min(columns // 3, _LEAST_SIDE) - 1
        left = _fitting(room * wide, (rows - 1) * high)
        beside = math.ceil(left[0] / wide) + 1
        right = _fitting((columns - beside) * wide, rows // 2 * high)
        free = rows - 1 - math.ceil(right[1] / high)
        seen, hands = self._seen(left), self._hands(right, step)
        canvas = np.zeros((2 * (rows - 1), columns, 3), np.uint8)
        if self.graphics is None:
            canvas[: left[1], : left[0]] = seen
            canvas[: right[1], beside : beside + right[0]] = hands
        text = self._blocks.draw(canvas, columns, rows - 1)
        if self.graphics is not None:
            text += self.graphics.draw(seen, 1, 1, 1)
            text += self.graphics.draw(hands, beside + 1, 1, 2)
        lines = self._lines(step, values, scores, min(columns - beside, _MAX_SIDE), free)
        for number, line in enumerate(lines[:free], rows - free):
            text += f"\x1b[{number};{beside + 1}H{_PLAIN}{line}{_PLAIN}\x1b[K"
        games = f"{counted(len(scores), 'game')} over"
        last = f"q leaves; {self._name} plays {self._title}, {games}{self._changes}"
        return f"{text}\x1b[{rows};1H{_PLAIN}{_DIM}{_cut(last, columns - 1)}{_PLAIN}\x1b[K\x1b[0m"

    def _seen(self, size: tuple[int, int]) -> NDArray[np.uint8]:
        """Returns the camera's picture with the detected screen; without a robot, the
        environment's."""
        env = self._env
        found = env.detection.corners if isinstance(env, RobotEnv) else None
        if found is None:
            return _scaled(env.seen, size)
        border = border_of(found)
        height, width = env.seen.shape[:2]
        high = min(_MARGIN * float(np.ptp(border[:, 1])), height)
        shown = np.array([width / height, 1]) * high
        corner = (border.mean(axis=0) - shown / 2).round().clip(0, (width, height) - shown)
        left, top = corner.astype(int)
        part = env.seen[top : top + round(high), left : left + round(high * width / height)]
        picture = _scaled(part, size)
        # Sixels have 256 colours, and a thin line would get none of them.
        thickness = 1 if self.graphics is None else 3
        for corners, colour in ((border, overlay.YELLOW), (found, overlay.MAGENTA)):
            place = np.asarray(corners - (left, top), np.float32)
            overlay.outline(picture, place, size[0] / part.shape[1], colour, thickness)
        return picture

    def _hands(self, size: tuple[int, int], step: Step) -> NDArray[np.uint8]:
        """Returns the hands at the controller; without a robot, the network's input."""
        env = self._env
        if isinstance(env, RobotEnv):
            return _scaled(env.view(*max(size, _HANDS), "hands"), size)
        return _scaled(cv2.cvtColor(step.s_t[-1], cv2.COLOR_GRAY2RGB), size)

    def _lines(
        self,
        step: Step,
        values: NDArray[np.float32] | None,
        scores: Sequence[float],
        width: int,
        rows: int,
    ) -> list[str]:
        """Returns the texts beside the picture, in at most ``width`` columns each."""
        env = self._env
        score = f"score {points(step.info.game_score)}"
        lines = [f"{_BOLD}{score}{_PLAIN}{_beside_score(step, scores, width - len(score))}"]
        if isinstance(env, RobotEnv):
            seen = f"{_GOOD}screen found" if env.detection.valid else f"{_BAD}screen NOT found"
            if env.detection.valid and env.detection.corners is None:
                seen = f"{_DIM}camera not used"
            lines += [seen, f"commanded {keys_text(env.wanted)}"]
            lines += [f"pressed   {keys_text(env.pressed)}"]
        else:
            lines.append(f"{_DIM}↑ network's input{_PLAIN}")
        if values is None:
            return [*lines, f"{_DIM}random play"]
        lines.append(f"{_DIM}Q-values")
        # If there is no room for all actions, the best ones are shown.
        for index, value, bar in q_bars(values, max(rows - len(lines), 1), width - 16):
            colour = _CHOSEN if index == step.a_tm1 else ""
            action = env.actions[index]
            name = f"{index:>5}" if action is None else keys_text(KEYS_OF_ACTION[action])
            lines.append(f"{colour}{name}{value} {bar}")
        return lines


def _beside_score(step: Step, scores: Sequence[float], width: int) -> str:
    """Returns the game's step and the scores of the latest games, as far as there is room."""
    latest, told = [points(score) for score in scores[-_MAX_BEFORE:]], ""
    before = [f"   games before {' '.join(latest[at:])}" for at in range(len(latest))]
    for choices in ([f"   step {step.info.game_steps}"], before):
        told += next((each for each in choices if len(told + each) <= width), "")
    return told


def _cut(text: str, columns: int) -> str:
    """Returns ``text`` in at most so many columns."""
    return text if len(text) <= columns else f"{text[: columns - 1]}…"


def _fitting(columns: int, pixel_rows: int) -> tuple[int, int]:
    """Returns width and height of the largest picture that fits, in half blocks or pixels."""
    width = min(columns, round(pixel_rows * ASPECT), _WIDEST)
    return width, round(width / ASPECT)


def _scaled(picture: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    return np.array(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
