"""The observation of both environments: the newest grey 84×84 frames, as in Mnih et al. (2015).

With ``play.vector`` it is a dictionary of the frames and a vector (`common.proprioception`).
"""

from typing import Any, TypeAlias

import cv2
import gymnasium
import numpy as np
from numpy.typing import NDArray

from common.proprioception import vector_width
from common.protocol.step_fields import FRAME_SHAPE
from common.settings.conditions import PlayConfig

Observation: TypeAlias = NDArray[np.uint8] | dict[str, Any]
"""Frames ``uint8 [frame_stack, 84, 84]``; or these as ``frames`` and ``vector float32 [P]``."""
NO_VECTOR: NDArray[np.float32] = np.zeros(0, np.float32)


def frames_and_vector(observation: Any) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Returns both parts of an environment's observation; the vector is empty if it has none."""
    if isinstance(observation, dict):
        return observation["frames"], observation["vector"]
    return observation, NO_VECTOR


def observation_space(play: PlayConfig, joints: int = 0) -> gymnasium.Space[Any]:
    """Returns the space of observations, with a vector if ``play.vector``.

    Args:
        joints: number of the robot's joints; 0 without a robot.
    """
    frames = gymnasium.spaces.Box(0, 255, (play.frame_stack, *FRAME_SHAPE), np.uint8)
    if not play.vector:
        return frames
    vector = gymnasium.spaces.Box(-1.0, 1.0, (vector_width(play, joints),), np.float32)
    return gymnasium.spaces.Dict(frames=frames, vector=vector)


def shrink(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Returns the grey picture ``uint8 [rows, columns]`` as a frame ``uint8 [84, 84]``.

    Each pixel is the mean of what it covers, so that nothing small falls between pixels.
    """
    frame = cv2.resize(grey, FRAME_SHAPE[::-1], interpolation=cv2.INTER_AREA)
    return np.asarray(frame, np.uint8)


class FrameStack:
    """The last ``frame_stack`` frames. A `state` never changes; a new one takes its place."""

    def __init__(self, frame_stack: int) -> None:
        self.state: NDArray[np.uint8] = np.zeros((frame_stack, *FRAME_SHAPE), np.uint8)
        """``uint8 [frame_stack, 84, 84]``, newest last."""

    def restart(self, frame: NDArray[np.uint8]) -> None:
        """Begins an episode, whose first state repeats its first frame."""
        self.state = np.repeat(frame[None], len(self.state), axis=0)

    def push(self, frame: NDArray[np.uint8]) -> None:
        """Takes a new frame for the oldest one."""
        state = np.empty_like(self.state)
        state[:-1] = self.state[1:]
        state[-1] = frame
        self.state = state
