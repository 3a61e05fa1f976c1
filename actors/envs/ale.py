"""ALE-Only: the agent at the emulator itself, without robot or camera (the report's figure 2)."""

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from actors.envs.game import REPORT_PLAY, AtariGame
from actors.envs.observation import FrameHistory, shrink
from common.chunk import FRAME_SHAPE
from common.config import PlayConfig


class AtariEnv(gymnasium.Env[NDArray[np.uint8], np.int64]):
    """One step is one decision of ``play.frame_skip`` emulator frames.

    Observation: ``uint8 [history, 84, 84]``, newest frame last. Action: an index into all 18
    actions, or into the game's own with ``play.minimal_actions``. Reward: points, not clipped.
    With ``training`` an episode also ends at a lost life, and the next ``reset()`` carries the
    same game on without touching the emulator. A ``reset()`` with a seed, with
    ``options={"new_game": True}`` or in the middle of an episode starts a new game.
    The keys of ``info`` are those of `AtariGame.info`.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 15}  # noqa: RUF012 - Gymnasium's way

    def __init__(
        self,
        game: str = "pong",
        *,
        play: PlayConfig = REPORT_PLAY,
        training: bool = False,
        render_mode: str | None = None,
    ) -> None:
        """Raises InputError for a game that ale-py does not bundle."""
        self.metadata = {**self.metadata, "render_fps": 60 / play.frame_skip}
        self.render_mode = render_mode
        # ALE repeats the action itself: four times faster than being asked for every frame.
        self._game = AtariGame(game, play, training=training, emulator_skip=play.frame_skip)
        self._frames = FrameHistory(play.history)
        self.action_space = gymnasium.spaces.Discrete(len(self._game.actions))
        self.observation_space = gymnasium.spaces.Box(
            0, 255, (play.history, *FRAME_SHAPE), np.uint8
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.uint8], dict[str, Any]]:
        """Begin an episode; its first state is its first frame, repeated."""
        super().reset(seed=seed)
        self._game.begin_episode(
            self.np_random,
            seeded=seed is not None,
            new_game=bool((options or {}).get("new_game", False)),
        )
        state = self._frames.restart(shrink(self._game.emulator.screen_grey()))
        return state, self._game.info(valid_frame=True, keys_match=True, elapsed=0)

    def step(
        self, action: np.int64 | int
    ) -> tuple[NDArray[np.uint8], float, bool, bool, dict[str, Any]]:
        """Hold the action for one decision."""
        reward = self._game.hold(self._game.actions[action])
        terminated, truncated = self._game.end_decision()
        state = self._frames.push(shrink(self._game.emulator.screen_grey()))
        info = self._game.info(valid_frame=True, keys_match=True, elapsed=1)
        return state, reward, terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """The emulator's screen, ``uint8 [rows, columns, 3]``, for render_mode "rgb_array"."""
        return self._game.emulator.screen_rgb() if self.render_mode == "rgb_array" else None
