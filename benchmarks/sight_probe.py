"""Whether ball and paddles are in the frames: a linear probe from pixels to the console's memory.

The probe is ridge regression from all 7,056 pixels of a single frame; its strength is chosen on
the last fifth of what it learns from, and it is judged on later games than these.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actors.envs.emulator import Emulator
from actors.envs.observation import shrink
from actors.nao.room import Room
from actors.vision.eye import Eye
from common.config import CameraConfig

QUANTITIES = {"own paddle's y": 51, "other paddle's y": 50, "ball's x": 49, "ball's y": 54}
"""Where Pong keeps them (Anand et al. 2019, AtariARI)."""
_STRENGTHS = (1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0)
"""Of the ridge, for pixels from 0 to 1."""
_MOST_HELD = 12
"""Decisions, at most, for which an action is held, so that the paddle comes everywhere."""


@dataclass(frozen=True)
class Frames:
    """Frames of Pong with the ball in play, in the order they were played."""

    own: NDArray[np.uint8]
    """The emulator's, ``uint8 [N, 84, 84]``."""
    seen: NDArray[np.uint8]
    """Through the robot's camera, likewise."""
    truth: NDArray[np.float64]
    """`QUANTITIES`, ``float64 [N, 4]``."""


def collect(count: int, camera: CameraConfig, seed: int) -> Frames:
    """Play at random for ``count`` decisions; only frames that the eye found valid are kept."""
    rng = np.random.default_rng(seed)
    emulator, room, eye = Emulator("pong", seed, frame_skip=4), Room(camera=camera), None
    own, seen, truth = [], [], []
    actions = np.repeat(rng.integers(18, size=count), rng.integers(1, _MOST_HELD, size=count))
    for action in actions[:count].tolist():
        if eye is None or emulator.game_over:
            emulator.reset()
            room.begin_game(rng)
            eye = Eye(camera.distortion)
        emulator.act(action)
        memory = emulator.ram()
        sight = eye.see(room.sensor.take(room.picture(emulator.screen_rgb())))
        where = [int(memory[place]) for place in QUANTITIES.values()]
        if sight.valid and all(where[2:]):  # the ball's are 0 while it is not in play
            own.append(shrink(emulator.screen_grey()))
            seen.append(sight.frame)
            truth.append(where)
    room.close()
    return Frames(np.array(own), np.array(seen), np.array(truth, np.float64))


def probe(frames: NDArray[np.uint8], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """R² of each quantity, ``float64 [4]``, on the last quarter of the frames."""
    pixels = frames.reshape(len(frames), -1).astype(np.float64) / 255
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


def _predict(
    known: NDArray[np.float64], truth: NDArray[np.float64], asked: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """What ridge regressions of all `_STRENGTHS` say for ``asked``, after ``known`` frames.

    Solved in the space of frames, which are fewer than pixels.
    """
    mean, usual = known.mean(axis=0), truth.mean(axis=0)
    known, asked = known - mean, asked - mean
    values, vectors = np.linalg.eigh(known @ known.T)
    onto = vectors.T @ (truth - usual)
    alike = asked @ known.T @ vectors
    return [
        usual + alike @ (onto / (np.maximum(values, 0)[:, None] + strength))
        for strength in _STRENGTHS
    ]


def _explained(found: NDArray[np.float64], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """R², quantity by quantity."""
    missed = ((found - truth) ** 2).sum(axis=0)
    result: NDArray[np.float64] = 1 - missed / ((truth - truth.mean(axis=0)) ** 2).sum(axis=0)
    return result
