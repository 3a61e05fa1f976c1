"""The world: hands and game advance together, one emulator frame at a time.

The clock (`actors.envs.clock`) decides when.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from operator import or_

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.envs.command_plan import CommandPlan
from actors.envs.game import AtariGame
from actors.envs.hands import hands_of
from actors.envs.key_watch import KeyWatch
from actors.envs.latency_equaliser import LatencyEqualiser
from actors.envs.proprioception import Proprioception
from actors.robots.interface import Hands
from common.actions import KEYS_OF_ACTION, Keys, action_of_keys
from common.settings.conditions import PlayConfig


@dataclass(frozen=True)
class AgentStep:
    """The outcome of one agent step of ``play.frame_skip`` emulator frames."""

    points: float
    pressed: Keys
    """The keys that the game got at the last frame."""
    terminated: bool
    truncated: bool
    late: bool = False
    """Whether a frame began more than a frame too late, at whatever speed the clock runs."""

    @property
    def ended(self) -> bool:
        """Whether the episode ended with it."""
        return self.terminated or self.truncated


class World:
    """Hands that get commands, and the game that plays by the keys they press.

    With ``play.read_keys`` "frame" the controller is read at the end of each frame's physics. With
    "decision" it is read once per agent step, before the arms move, and the game gets these keys
    for the whole step (as in 2017: read, act on the emulator, and only then simulate).
    """

    def __init__(
        self,
        own: Hands | None,
        game: AtariGame,
        play: PlayConfig,
        joints: int = 0,
        posture: Callable[[], tuple[NDArray[np.float64], ...]] = tuple,
    ) -> None:
        """Takes the hands that ``play`` asks for, at rest.

        Args:
            own: the robot, or a latency model; None if there is neither.
            joints: number of the robot's joints; 0 without a robot.
            posture: returns their angles and speeds, as `Robot.proprioception`.
        """
        self.wanted = Keys.NONE
        """The keys of the last command."""
        self.pressed = Keys.NONE
        """The keys that the game got at the last frame."""
        self.key_watch = KeyWatch()
        """Times the hands, whenever the controller is read."""
        self._own = own
        self._posture = posture
        self._plan = CommandPlan.of_play(play)
        self._take_hands(play, np.random.default_rng(0))
        self._game = game
        self._play = play
        self._sense = Proprioception(play, joints) if play.vector else None
        self._frames = 0  # frames of the present agent step that have passed
        self._points = 0.0

    def vector(self) -> NDArray[np.float32] | None:
        """Returns the present vector observation, if ``play.vector`` asks for one."""
        if self._sense is None:
            return None
        return self._sense.vector(*self._posture())

    def begin_game(self, play: PlayConfig, rng: Generator) -> None:
        """Takes the hands that ``play`` asks for, and calls `restart` for a new game."""
        self._take_hands(play, rng)
        self.see_late(0)
        if self._equaliser is not None:
            self._equaliser.time(reduce(or_, (KEYS_OF_ACTION[each] for each in self._game.actions)))
        self.restart()

    def see_late(self, frames: int) -> None:
        """Sets the latency of the eye's pictures, in emulator frames.

        The observed keys are made as late, so that both are of one moment.
        """
        if self._equaliser is not None:
            self._equaliser.seen_late = frames
        if self._sense is not None:
            self._sense.seen_late = frames

    def restart(self) -> None:
        """Puts the hands at rest and forgets everything, because a game begins."""
        self._hands.rest()
        self.wanted = self.pressed = Keys.NONE
        self._frames, self._points = 0, 0.0
        if self._sense is not None:
            self._sense.forget()

    def command(self, action: int) -> None:
        """Sends the hands to the keys of one of the 18 actions."""
        self.wanted = KEYS_OF_ACTION[action]
        if self._equaliser is None:  # an equaliser itself reports the commands that it gives
            self.key_watch.give()
        self._hands.command(self.wanted)
        if self._sense is not None:
            self._sense.command(action)

    def frame(self) -> AgentStep | None:
        """Passes one emulator frame (1/60 s); returns the agent step that it completes, if any."""
        if self._play.read_keys == "decision" and self._frames == 0:
            self.pressed = self._hands.held
        felt = self._hands.step_frame()
        if self._play.read_keys == "frame":
            self.pressed = felt
        if self._sense is not None:
            self._sense.feel(felt)
        self._points += self._game.hold(action_of_keys(self.pressed))
        self._frames += 1
        if self._frames < self._play.frame_skip:
            return None
        agent_step = AgentStep(self._points, self.pressed, *self._game.end_agent_step())
        self._frames, self._points = 0, 0.0
        if agent_step.ended:
            self.key_watch.give_up()
        return agent_step

    def finish_agent_step(self) -> AgentStep:
        """Passes the remaining frames of the agent step, and returns it."""
        while (agent_step := self.frame()) is None:
            pass
        return agent_step

    def _take_hands(self, play: PlayConfig, rng: Generator) -> None:
        self._hands: Hands = hands_of(play, self._own, rng, self.key_watch)
        self._equaliser: LatencyEqualiser | None = None
        if play.equal_latency:
            self._hands = self._equaliser = LatencyEqualiser(
                self._hands, play.equal_latency, play.equal_gap, self.key_watch.give, self._plan
            )
