"""ALE-Robot: the agent behind a NAO's camera and hands (the report's figure 1), in lockstep."""

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from actors.envs.game import REPORT_PLAY, AtariGame
from actors.envs.observation import FrameHistory
from actors.nao.room import Room
from actors.vision.eye import Eye, Sight
from common.actions import KEYS_OF_ACTION, Keys, action_of_keys
from common.chunk import FRAME_SHAPE
from common.config import PlayConfig


class RobotEnv(gymnasium.Env[NDArray[np.uint8], np.int64]):
    """One step is one decision of ``play.frame_skip`` emulator frames, 1/60 s each.

    An action sends the hands to its keys; before every emulator frame the physics goes on and
    the controller is read, and the keys that are then really pressed are what the game gets. The
    state's frames come from the robot's camera only. Spaces, rewards, episodes and ``info`` are
    those of `AtariEnv`, so that the two can be compared.
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
        self._play = play
        # The random start is not the emulator's here: it goes through the hands, see `reset`.
        self._game = AtariGame(game, replace(play, random_starts=0), training=training)
        self._room = Room(self._game.emulator.screen_shape)
        self._eye = Eye()
        self._frames = FrameHistory(play.history)
        self.action_space = gymnasium.spaces.Discrete(len(self._game.actions))
        self.observation_space = gymnasium.spaces.Box(
            0, 255, (play.history, *FRAME_SHAPE), np.uint8
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.uint8], dict[str, Any]]:
        """Begin an episode; its first state is what is seen first, repeated.

        A new game begins with the hands at rest and up to ``play.random_starts`` random
        decisions; a game that goes on after a lost life leaves everything as it is.
        """
        super().reset(seed=seed)
        if self._game.begin_episode(
            self.np_random,
            seeded=seed is not None,
            new_game=bool((options or {}).get("new_game", False)),
        ):
            self._room.reset()
            # Nothing of an earlier game may show in a seeded one, not even where the screen was.
            self._eye = Eye()
            self._play_random_start()
        sight = self._look()
        state = self._frames.restart(sight.frame)
        return state, self._game.info(valid_frame=sight.valid, keys_match=True, elapsed=0)

    def step(
        self, action: np.int64 | int
    ) -> tuple[NDArray[np.uint8], float, bool, bool, dict[str, Any]]:
        """Let the hands set out for the action's keys, and let one decision pass."""
        reward, pressed, wanted = self._decide(self._game.actions[action])
        terminated, truncated = self._game.end_decision()
        sight = self._look()
        info = self._game.info(valid_frame=sight.valid, keys_match=pressed == wanted, elapsed=1)
        return self._frames.push(sight.frame), reward, terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """The room from outside, ``uint8 [480, 640, 3]``, for render_mode "rgb_array"."""
        if self.render_mode != "rgb_array":
            return None
        return self._room.view(self._game.emulator.screen_rgb())

    def close(self) -> None:
        """End the physics."""
        self._room.close()

    def _decide(self, action: int) -> tuple[float, Keys, Keys]:
        """Points, keys pressed at the end and keys wanted, of one decision."""
        wanted = KEYS_OF_ACTION[action]
        self._room.command(wanted)
        points, pressed = 0.0, Keys.NONE
        for _ in range(self._play.frame_skip):
            pressed = self._room.step_frame()
            points += self._game.hold(action_of_keys(pressed))
        return points, pressed, wanted

    def _look(self) -> Sight:
        return self._eye.see(self._room.picture(self._game.emulator.screen_rgb()))

    def _play_random_start(self) -> None:
        count = self.np_random.integers(self._play.random_starts + 1)
        for action in self.np_random.choice(self._game.actions, count):
            self._decide(int(action))
            terminated, _ = self._game.end_decision()
            if self._game.over:  # an unlucky start: play from the very beginning instead
                self._game.begin_episode(self.np_random, seeded=False, new_game=True)
                self._room.reset()
                return
            if terminated:  # a life lost before the episode began does not end it
                self._game.begin_episode(self.np_random, seeded=False, new_game=False)
