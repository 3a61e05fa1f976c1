"""Measures whether frames show ball and paddles, by a linear probe for the console's memory.

The probe is ridge regression from all 7,056 pixels of a single frame and two blurs of them. The
blurs let neighbouring pixels count alike: the ball is two pixels wide, and plain pixels would know
nothing about places at which it was never seen in training. The probe stays linear in the pixels.
Its strength is chosen on the last fifth of its training data, and it is tested on later play.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from actors.envs.emulator import Emulator
from actors.envs.observation import shrink
from actors.robots.nao.robot import Nao
from actors.vision.screen_detector import ScreenDetector
from benchmarks.lab.sight_poses import FaultyCamera, begin_game
from common.settings.ranges import NOTHING_DRAWN

QUANTITIES = {"own paddle's y": 51, "other paddle's y": 50, "ball's x": 49, "ball's y": 54}
"""Addresses in Pong's memory of what is probed (Anand et al. 2019, AtariARI)."""
_STRENGTHS = (1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0)
"""Strengths of the ridge that are tried, for pixels from 0 to 1."""
_FOLLOWS = ("own paddle's y", "ball's y")
_MIDDLE = 8
"""Middle of the paddle, in rows of the console below its upper end."""
_UP, _DOWN = 2, 5
_BLURS = (3.0, 8.0)
"""Standard deviations, pixels."""
_MAX_FRAMES = 7
"""Maximum frames from one picture to the next; if it were always 4, the ball would be seen at few
places only."""
_WHIMS = 0.1
"""Probability, at each agent step, of a random action that is then held for a while."""
_MAX_HELD = 7
"""Maximum number of agent steps for which it is held."""


@dataclass(frozen=True)
class Frames:
    """Frames of Pong with the ball in play, in the order of play."""

    own: NDArray[np.uint8]
    """Frames of the emulator, ``uint8 [N, 84, 84]``."""
    seen: NDArray[np.uint8]
    """Frames seen through the robot's camera, ``uint8 [N, 84, 84]``."""
    truth: NDArray[np.float64]
    """True `QUANTITIES`, ``float64 [N, 4]``."""


def collect(count: int, eye: FaultyCamera, seed: int) -> Frames:
    """Takes ``count`` pictures of play; returns those with the ball in play and a valid frame.

    The paddle follows the ball, with random actions in between. Random play alone would lose nearly
    every ball at once, and always in the same way.
    """
    rng = np.random.default_rng(seed)
    emulator, room, detector = Emulator("pong", seed), Nao(), None
    own, seen, truth = [], [], []
    held, left = 0, 0
    for _ in range(count):
        if detector is None or emulator.game_over:
            emulator.reset()
            begin_game(room, eye, NOTHING_DRAWN, rng)
            detector = ScreenDetector(room.camera.distortion)
        if left == 0 and rng.random() < _WHIMS:
            held, left = int(rng.integers(18)), int(rng.integers(1, _MAX_HELD + 1))
        if left:
            action, left = held, left - 1
        else:
            paddle, ball = (int(emulator.ram()[QUANTITIES[name]]) for name in _FOLLOWS)
            action = _UP if ball < paddle + _MIDDLE else _DOWN
        for _ in range(rng.integers(1, _MAX_FRAMES + 1)):
            emulator.act(action)
        memory = emulator.ram()
        detection = detector.detect(room.sensor.take(room.picture(emulator.screen_rgb())))
        where = [int(memory[place]) for place in QUANTITIES.values()]
        if detection.valid and all(where[2:]):  # x and y are 0 while the ball is not in play
            own.append(shrink(emulator.screen_grey()))
            seen.append(detection.frame)
            truth.append(where)
    room.close()
    return Frames(np.array(own), np.array(seen), np.array(truth, np.float64))


def probe(frames: NDArray[np.uint8], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the R² of each quantity, ``float64 [4]``, on the last quarter of the frames."""
    pixels = _features(frames)
    learned = len(frames) * 3 // 4
    chosen_on = learned * 4 // 5
    chosen = [
        _explained(found, truth[chosen_on:learned])
        for found in _predict(pixels[:chosen_on], truth[:chosen_on], pixels[chosen_on:learned])
    ]
    best = np.argmax(chosen, axis=0)
    judged = _predict(pixels[:learned], truth[:learned], pixels[learned:])
    explained = np.array([_explained(found, truth[learned:]) for found in judged])
    result: NDArray[np.float64] = explained[best, np.arange(truth.shape[1])]
    return result


def _features(frames: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Returns pixels from 0 to 1 and their blurs, a row for each frame; linear in the pixels."""
    light = np.divide(frames, 255, dtype=np.float32)
    blurs = [
        # Scaled so that a small object weighs as much as it does unblurred.
        np.stack([cv2.GaussianBlur(frame, (0, 0), width) for frame in light])
        * np.float32(2 * width * np.sqrt(np.pi))
        for width in _BLURS
    ]
    return np.concatenate([part.reshape(len(frames), -1) for part in (light, *blurs)], axis=1)


def _predict(
    known: NDArray[np.float32], truth: NDArray[np.float64], asked: NDArray[np.float32]
) -> list[NDArray[np.float64]]:
    """Returns what ridge regressions on the ``known`` frames predict for ``asked``, one for each of
    `_STRENGTHS`.

    They are solved in the space of frames, of which there are fewer than pixels.
    """
    mean, usual = known.mean(axis=0), truth.mean(axis=0)
    known, asked = known - mean, asked - mean
    values, vectors = np.linalg.eigh((known @ known.T).astype(np.float64))
    onto = vectors.T @ (truth - usual)
    alike = (asked @ known.T) @ vectors
    return [
        usual + alike @ (onto / (np.maximum(values, 0)[:, None] + strength))
        for strength in _STRENGTHS
    ]


def _explained(found: NDArray[np.float64], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    missed = ((found - truth) ** 2).sum(axis=0)
    result: NDArray[np.float64] = 1 - missed / ((truth - truth.mean(axis=0)) ** 2).sum(axis=0)
    return result
