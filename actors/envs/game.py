"""The game as an environment plays it: conditions, starts, lives, points, episodes and ends.

`AtariEnv` and `RobotEnv` both own an `AtariGame`, so that emulator and robot obey the same rules
and their scores can be compared. They differ only in what presses the keys and what sees the game.
"""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.random import Generator

from actors.envs.emulator import Emulator
from common.checked import Fraction
from common.settings.conditions import PERFECT_CAMERA, CameraConfig, Conditions, PlayConfig
from common.settings.ranges import NOTHING_DRAWN, RandomiseConfig, draw
from common.settings.stored_config import from_mapping


class AtariGame:
    """One console on which game after game is played.

    A *game* lasts from reset to game over, or until ``play.max_game_frames`` cut it short. When
    training, a lost life ends only the *episode*: the next one continues the same game. Time is
    counted in *agent steps* of ``play.frame_skip`` emulator frames: one `hold` for each frame, and
    then `end_agent_step`.
    """

    def __init__(
        self,
        game: str,
        play: PlayConfig,
        camera: CameraConfig = PERFECT_CAMERA,
        randomise: RandomiseConfig = NOTHING_DRAWN,
        *,
        training: bool,
        random_start: bool = True,
    ) -> None:
        """Powers the console on.

        Args:
            randomise: ranges from which each game's conditions are drawn.
            random_start: whether the game plays ``play.random_starts`` itself.

        Raises:
            InputError: ale-py does not bundle the game.
        """
        self.emulator = Emulator(game, 0, sticky=play.sticky)
        """The console. Do not keep it: the first game and every seeded episode replace it."""
        self.actions: tuple[int, ...] = (
            self.emulator.minimal_actions if play.minimal_actions else tuple(range(18))
        )
        """ALE's numbers of the actions on offer."""
        self.score = 0.0
        """Points of the present game, its random start included."""
        self.steps = 0
        """Agent steps of the present game, its random start included."""
        self.over = False
        """Whether the game ended at the last agent step, by its own rules or cut short."""
        self.conditions = self._usual = Conditions(play, camera)
        """The conditions of the present game, drawn around the usual ones."""
        self._randomise = randomise
        self._play = play
        self._training = training
        self._random_starts = play.random_starts if random_start else 0
        self._lives = self.emulator.lives
        self._life_lost = False
        self._used = False
        self._carries_on = False

    def begin_episode(self, rng: Generator, *, seeded: bool, options: Mapping[str, Any]) -> bool:
        """Continues the game after a lost life, or starts a new one; returns whether it is new.

        Args:
            rng: Draws the conditions and the random start of a new game.
            seeded: Whether everything that follows must depend on ``rng`` alone. The console is
                then switched off and on, because some games (Freeway) keep memory across ALE's
                reset, and its sticky actions begin with a seed from ``rng``.
            options: The options of an environment's ``reset``. With "new_game" a new game starts
                even if the present one could go on. "difficulty" is the share of the ranges' widths
                from which conditions are drawn, 1 by default.
        """
        new = seeded or bool(options.get("new_game")) or not self._carries_on
        if new:
            difficulty = from_mapping(Fraction, options.get("difficulty", 1.0), "difficulty")
            self.conditions = draw(
                self._usual.play, self._usual.camera, self._randomise, rng.random, difficulty
            )
            if self._play.latency_model:
                # By a generator of its own, so that games begin as they do without a model.
                copy = int(rng.spawn(1)[0].integers(2**31))
                self.conditions = self.conditions._replace(copy=copy)
            self.start_anew(rng, power_on=seeded)
        else:
            self.carry_on()
        return new

    def start_anew(self, rng: Generator, *, power_on: bool = False) -> None:
        """Starts a new game under the present conditions."""
        sticky = self.conditions.play.sticky
        if power_on or not self._used or sticky != self.emulator.sticky:
            # Without sticky actions nothing is drawn, so that such games stay as they were.
            seed = int(rng.integers(2**31)) if sticky > 0 else 0
            self.emulator = Emulator(self.emulator.game, seed, sticky=sticky)
        else:
            self.emulator.reset()
        self._used = True
        self.score, self.steps = 0.0, 0
        for action in rng.choice(self.actions, rng.integers(self._random_starts + 1)):
            for _ in range(self._play.frame_skip):
                self.score += self.emulator.act(int(action))
            self.steps += 1
            if self.emulator.game_over:  # an unlucky start: play from the very beginning instead
                self.emulator.reset()
                self.score, self.steps = 0.0, 0
                break
        self.carry_on()

    def carry_on(self) -> None:
        """Begins an episode with the lives that are left."""
        self.over = self._carries_on = self._life_lost = False
        self._lives = self.emulator.lives

    def hold(self, action: int) -> float:
        """Holds one of the 18 actions for an emulator frame; returns the points that it made.

        After game over it does nothing and returns 0.
        """
        points = self.emulator.act(action)
        lives = self.emulator.lives
        self._life_lost |= lives < self._lives
        self._lives = lives
        self.score += points
        return points

    def end_agent_step(self) -> tuple[bool, bool]:
        """Counts an agent step; returns whether it terminated, or truncated, the episode."""
        self.steps += 1
        limit = self._play.max_game_frames
        ended = self.emulator.game_over
        cut = 0 < limit <= self.emulator.frames
        self.over = ended or cut
        terminated = ended or (self._training and self._life_lost)
        self._carries_on = terminated and not self.over
        return terminated, cut and not terminated

    def action(self, index: np.int64 | int) -> int:
        """Returns ALE's number of the action that ``index`` of a step stands for.

        Raises:
            gymnasium.error.InvalidAction: there is no such action.
            gymnasium.error.ResetNeeded: no game has begun.
        """
        if not self._used:
            raise gymnasium.error.ResetNeeded("no game has begun: call reset() before step().")
        if not 0 <= index < len(self.actions):
            raise gymnasium.error.InvalidAction(
                f"there is no action {index}: choose a number from 0 to {len(self.actions) - 1}."
            )
        return self.actions[index]

    @property
    def standing(self) -> tuple[bool, float, int]:
        """The first three fields of `StepInfo`: whether the game is over, its score, its steps."""
        return self.over, self.score, self.steps
