"""Draws environments into the terminal: Gymnasium's render_mode "human", as a wrapper.

The environments themselves support only "rgb_array".
"""

import math
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from viewer.terminal.window import TerminalWindow

ROOM_EVERY = 4
"""Agent steps between renderings of the room, each of which takes as long as one; the game on its
screen is always new."""
_ROOM_SIZE = (256, 192)
"""Width and height of the room's picture, pixels; small, because the terminal's cells are large."""


class TerminalRendering(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Draws ``env``, which renders "rgb_array", after every reset and step.

    Args:
        aspect: width by height of the picture, for an environment whose pixels are not square.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], aspect: float | None = None) -> None:
        super().__init__(env)
        rate = float(env.metadata["render_fps"])
        self.metadata = {"render_modes": ["human", "rgb_array"], "render_fps": rate}
        clock = getattr(env.unwrapped, "clock", None)
        # In real time the world's clock sets the pace, and the window must not slow it down.
        self._window = TerminalWindow(rate if clock is None or clock.sync else math.inf)
        self._aspect = aspect
        self._view: Callable[..., NDArray[np.uint8]] | None = getattr(env.unwrapped, "view", None)
        self._shown = 0  # pictures since the last reset

    @property
    def render_mode(self) -> str:  # type: ignore[override]
        return "human"

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        outcome = self.env.reset(seed=seed, options=options)
        self._shown = 0
        self._show()
        return outcome

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        outcome = self.env.step(action)
        self._show()
        return outcome

    def render(self) -> None:
        """Does nothing, because every step is drawn already."""

    def close(self) -> None:
        self._window.close()
        self.env.close()

    def _show(self) -> None:
        picture: Any
        if self._view is None:
            picture = self.env.render()
        else:
            picture = self._view(*_ROOM_SIZE, moved=self._shown % ROOM_EVERY == 0)
        self._shown += 1
        self._window.show(picture, self._aspect)
