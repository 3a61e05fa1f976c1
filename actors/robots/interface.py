"""The protocol of a robot: all that an environment knows about it.

A new robot is a module that implements `Robot` and an entry in `common.registry.ROBOTS`.
"""

from typing import Protocol

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from common.actions import Keys
from common.protocol.live_view import ViewName
from common.settings.conditions import Conditions


class Hands(Protocol):
    """Presses the controller's keys: a robot, or a model of its latency."""

    @property
    def held(self) -> Keys:
        """The keys that were pressed at the end of the last frame."""

    def rest(self) -> None:
        """Takes every hand off the keys and drops all commands, whatever happened before."""

    def command(self, keys: Keys) -> None:
        """Sets out to hold exactly ``keys`` down."""

    def step_frame(self) -> Keys:
        """Passes one emulator frame (1/60 s); returns the keys that are pressed at its end."""


class Robot(Hands, Protocol):
    """A robot with its hands on a controller and its camera before the game's screen.

    Its factory gets the screen's rows and columns, the `CameraConfig` and the `PlayConfig`.
    """

    def begin_game(self, conditions: Conditions, rng: Generator) -> None:
        """Sets hands and eye as ``conditions`` say, for a new game; the eye forgets all earlier
        pictures. It may be called again before the game's first step.

        Args:
            rng: the game's generator; it seeds what changes within the game, such as noise.
        """

    def camera_picture(self, screen: NDArray[np.uint8], agent_steps: int = 1) -> NDArray[np.uint8]:
        """Returns the robot's camera picture, ``uint8 [240, 320, 3]``.

        Args:
            screen: the game's picture, ``uint8 [rows, columns, 3]``.
            agent_steps: agent steps of game time since the last picture was taken.
        """

    def proprioception(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns the joints' angles and speeds, ``float64 [J]`` each.

        Angles are -1 to 1 between their limits, speeds are shares of their maximum.
        """

    def true_corners(self) -> NDArray[np.float64] | None:
        """Returns the true corners of the projected picture in the camera picture.

        They are ``float64 [4, 2]``, clockwise from the top left; None if unknown.
        """

    def view(
        self,
        screen: NDArray[np.uint8],
        width: int,
        height: int,
        viewpoint: ViewName = "room",
        *,
        moved: bool = True,
        turn: float = 0.0,
    ) -> NDArray[np.uint8]:
        """Returns a picture for people, ``uint8 [height, width, 3]``.

        Without ``moved`` only the game on the screen has to be new. ``turn`` is the angle in
        degrees by which an orbiting view is turned about its target, counterclockwise from above.
        """

    def close(self) -> None:
        """Releases what the robot holds; closing twice does no harm."""
