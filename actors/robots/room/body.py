"""What a room asks of its robot: limbs that move, and the controller whose keys they press."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from common.actions import Keys


class _Moving(Protocol):
    body: int
    """Body in the physics client."""

    @property
    def movables(self) -> list[tuple[int, float]]:
        """Links that move, each with the radius around its centre of mass that holds what is drawn
        of it, m."""


class Limbs(_Moving, Protocol):
    """Arms or servos, which follow commands by their motors."""

    def limit_speed(self, share: float) -> None:
        """From the next target on, let no joint be faster than ``share`` of its usual speed."""

    def command(self, keys: Keys) -> None:
        """Set out to hold exactly ``keys`` down."""

    def advance(self) -> None:
        """Set the motors' targets for one emulator frame; call it before that frame's physics."""

    def settle(self) -> None:
        """Put everything at rest, at once, with no command on its way."""

    def posture(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns angles and speeds of the joints; see `Robot.proprioception`."""


class Pressed(_Moving, Protocol):
    """A controller or joystick, whose keys the limbs press."""

    @property
    def held(self) -> Keys:
        """The keys that were held down when `pressed` was last called."""

    def set_threshold(self, share: float) -> None:
        """Let a key count as pressed and as released at ``share`` of the usual depths."""

    def pressed(self) -> Keys:
        """Returns the keys held down now; call it once per frame."""

    def show(self) -> None:
        """Colour pressed and released keys; call it before rendering them."""

    def forget(self) -> None:
        """Treat every key as released, after the physics was restored to its start."""
