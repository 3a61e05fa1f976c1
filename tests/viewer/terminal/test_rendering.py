"""The wrapper that draws environments in the terminal, with a window of the test's own."""

from typing import Any

import gymnasium
import numpy as np
import pytest

from common.settings.clock import ClockConfig
from viewer.terminal import rendering
from viewer.terminal.rendering import ROOM_EVERY, TerminalRendering


class Window:
    def __init__(self, rate: float) -> None:
        self.rate = rate
        self.shown: list[tuple[int, float | None]] = []
        self.closed = False

    def show(self, picture: Any, aspect: float | None) -> None:
        self.shown.append((int(picture[0, 0, 0]), aspect))

    def close(self) -> None:
        self.closed = True


class Plain(gymnasium.Env[int, int]):
    """An environment from elsewhere; its pictures count its steps."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 12}  # noqa: RUF012
    render_mode = "rgb_array"
    steps = 0

    def reset(self, **_: Any) -> tuple[int, dict[str, Any]]:
        self.steps = 0
        return 0, {}

    def step(self, action: int) -> tuple[int, float, bool, bool, dict[str, Any]]:
        self.steps += 1
        return self.steps, 1.0, False, False, {}

    def render(self) -> Any:
        return np.full((3, 4, 3), self.steps, np.uint8)


class Viewed(Plain):
    """One in real time whose view can leave the room as it was."""

    clock = ClockConfig(sync=False)
    moves: list[bool]

    def view(self, width: int, height: int, *, moved: bool) -> Any:
        self.moves.append(moved)
        return np.full((height, width, 3), 7, np.uint8)


@pytest.fixture(autouse=True)
def _window(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rendering, "TerminalWindow", Window)


def test_every_reset_and_step_is_drawn() -> None:
    env = TerminalRendering(Plain(), aspect=1.5)
    assert env.render_mode == "human"
    assert env.reset(seed=1) == (0, {})
    assert [env.step(0)[0] for _ in range(3)] == [1, 2, 3]
    window: Any = env._window
    assert window.rate == 12
    assert window.shown == [(0, 1.5), (1, 1.5), (2, 1.5), (3, 1.5)]
    env.close()
    assert window.closed


def test_the_room_is_rendered_now_and_then_and_never_held_up_in_real_time() -> None:
    viewed = Viewed()
    viewed.moves = []
    env = TerminalRendering(viewed)
    env.reset()
    for _ in range(5):
        env.step(0)
    assert ROOM_EVERY == 4
    assert viewed.moves == [True, False, False, False, True, False]
    env.reset()
    assert viewed.moves[-1]
    window: Any = env._window
    assert window.rate == float("inf")
    assert window.shown == [(7, None)] * 7
