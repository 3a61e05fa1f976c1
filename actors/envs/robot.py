"""ALE-Robot: the agent plays through a robot's camera and hands (figure 1 of 2017).

It knows robots only by the `Robot` protocol; `ClockConfig` says how time passes.
"""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from actors.envs.clock import Clock, Lockstep, RealTime
from actors.envs.eye import Eye
from actors.envs.game import AtariGame
from actors.envs.game_env import GameEnv
from actors.envs.observation import Observation
from actors.envs.step_info import StepInfo
from actors.envs.world import AgentStep, World
from actors.robots.interface import Robot
from actors.vision.screen_detector import Detection
from common.counted import counted
from common.errors import InputError
from common.protocol.live_view import ViewName
from common.registry import ROBOTS
from common.settings.clock import ClockConfig
from common.settings.conditions import DEFAULT_PLAY, PERFECT_CAMERA, CameraConfig, PlayConfig
from common.settings.config import RunConfig
from common.settings.ranges import NOTHING_DRAWN, RandomiseConfig

LOCKSTEP = ClockConfig()


class RobotEnv(GameEnv):
    """A robot as an environment; a step is usually one agent step.

    An agent step is ``play.frame_skip`` emulator frames of 1/60 s. An action sends the hands to its
    keys. Before every emulator frame the physics advances and the controller is read: the game gets
    the keys that are then really pressed. The state's frames come from the robot's camera only.
    Spaces, rewards, episodes and ``info`` (`StepInfo`) are those of `AtariEnv`, so that the two can
    be compared.

    A step takes several agent steps if the agent waits for its keys or, in real time, was too slow.
    Its reward is then the sum of their points, each discounted by the time that had passed, so that
    ``reward + discount ** info["elapsed"] * value`` is the return.
    """

    def __init__(
        self,
        game: str = "pong",
        *,
        play: PlayConfig = DEFAULT_PLAY,
        camera: CameraConfig = PERFECT_CAMERA,
        randomise: RandomiseConfig = NOTHING_DRAWN,
        clock: ClockConfig = LOCKSTEP,
        training: bool = False,
        discount: float = 1.0,
        clip_rewards: bool = False,
        render_mode: str | None = None,
    ) -> None:
        """Sits ``play.robot`` down at its desk.

        Args:
            randomise: ranges from which each game's conditions are drawn.
            discount: γ per agent step, within steps of several agent steps.
            clip_rewards: whether each agent step's points are clipped to -1 to 1. Scores are not.

        Raises:
            InputError: there is no such robot, or ale-py does not bundle the game.
        """
        self.clock = clock
        joints = ROBOTS.find(play.robot).joints
        # The emulator plays no random start: it goes through the hands, see `reset`.
        console = AtariGame(game, play, camera, randomise, training=training, random_start=False)
        self.robot: Robot = ROBOTS.make(play.robot, console.emulator.screen_shape, camera, play)
        """The robot and everything around it."""
        try:
            if (found := len(self.robot.proprioception()[0])) != joints:
                raise InputError(
                    f"the robot {play.robot!r} has {counted(found, 'joint')}, and its `RobotKind` "
                    f"declares {joints}: mend that."
                )
            world = World(self.robot, console, play, joints, self.robot.proprioception)
        except InputError:  # such as of a damaged model of the hands
            self.robot.close()
            raise
        super().__init__(console, world, play, render_mode, joints)
        self._eye = Eye(self.robot, console, play.eye)
        self._clock: Clock = (
            Lockstep(self._world) if clock.sync else RealTime(self._world, clock.speed)
        )
        self._most_agent_steps = play.wait_bound if clock.wait_action else 1
        self._discount = discount
        self._clip_rewards = clip_rewards
        self._late_frames = 0

    @classmethod
    def of_run(cls, config: RunConfig, clock: ClockConfig, *, training: bool) -> Self:
        """Returns the environment of a run."""
        return cls(
            config.game,
            play=config.play,
            camera=config.camera,
            randomise=config.randomise,
            clock=clock,
            training=training,
            discount=config.learning.discount,
            clip_rewards=config.learning.clip_rewards,
        )

    def still(self) -> AbstractContextManager[object]:
        return self._clock.still()

    def paused(self) -> AbstractContextManager[object]:
        return self._clock.paused()

    @property
    def seen(self) -> NDArray[np.uint8]:
        """The camera's last picture, ``uint8 [240, 320, 3]``."""
        with self.still():
            return self._eye.picture

    @property
    def detection(self) -> Detection:
        """The game as detected in the last picture."""
        return self._eye.detection

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode, whose first state repeats the first frame that is seen.

        A new game begins with the hands at rest and up to ``play.random_starts`` random agent
        steps. A game that continues after a lost life leaves everything as it is. Even in real
        time, no game time passes between two episodes, and the random start is played as fast as
        the machine goes.
        """
        self._clock.stop()
        if self._begin_episode(seed, options):
            self.robot.begin_game(self.conditions, self.np_random)
            self._world.begin_game(self.conditions.play, self.np_random)
            self._eye.begin_game()
            self._time_eye(self._eye.measure_latency)
            self._play_random_start()
            self._world.key_watch.disregard()  # no policy gave the commands of the random start
        self._frames.restart(self._eye.look(0))
        observation, info = self._observation(), self._info([], 0, ())
        self._clock.start()
        return observation, info

    def step(self, action: np.int64 | int) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Sends the hands to the action's keys, and lets time pass."""
        # Time passes only while the clock waits, so that all that is told is of the step's end.
        with self.still():
            agent_steps = self._clock.command(self._game.action(action))
            missed = len(agent_steps)
            told = 0  # agent steps of which the eye knows
            while not agent_steps or not agent_steps[-1].ended:
                agent_steps += self._clock.pass_agent_step()
                waited = len(agent_steps) - missed
                if self._obeyed(agent_steps[-1]) or waited >= self._most_agent_steps:
                    break
                self._eye.wait(len(agent_steps) - told)
                told = len(agent_steps)
            last = agent_steps[-1]
            # Unless the agent waits, the command is for one agent step, and later ones are missed.
            obeying = agent_steps[missed : None if self.clock.wait_action else missed + 1]
            kept = sum(not agent_step.late for agent_step in obeying)
            self._frames.push(self._eye.look(len(agent_steps) - told))
            info = self._info(agent_steps, len(agent_steps) - kept, self._world.key_watch.take())
            reward = self._reward(agent_steps)
            return self._observation(), reward, last.terminated, last.truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """Returns the room from outside, ``uint8 [480, 640, 3]``; None unless render_mode is
        "rgb_array"."""
        return self.view(640, 480) if self.render_mode == "rgb_array" else None

    def view(
        self, width: int, height: int, viewpoint: ViewName = "room", *, moved: bool = True
    ) -> NDArray[np.uint8]:
        """Returns the robot from outside as in `Robot.view`, ``uint8 [height, width, 3]``."""
        with self.still():
            screen = self.emulator.screen_rgb()
            return self.robot.view(screen, width, height, viewpoint, moved=moved)

    def close(self) -> None:
        """Ends the clock and the physics."""
        self._clock.close()
        self.robot.close()

    def _obeyed(self, agent_step: AgentStep) -> bool:
        return agent_step.pressed == self._world.wanted

    def _reward(self, agent_steps: Sequence[AgentStep]) -> float:
        points = [agent_step.points for agent_step in agent_steps]
        if self._clip_rewards:
            points = [min(max(each, -1.0), 1.0) for each in points]
        return sum(self._discount**time * each for time, each in enumerate(points))

    def _info(
        self,
        agent_steps: Sequence[AgentStep],
        missed: int,
        key_times: tuple[int, ...],
    ) -> dict[str, Any]:
        late, self._late_frames = (
            self._clock.late_frames - self._late_frames,
            self._clock.late_frames,
        )
        obeyed = not agent_steps or self._obeyed(agent_steps[-1])
        return StepInfo(
            *self._game.standing,
            valid_frame=self.detection.valid,
            frame_follows=self._eye.follows,
            keys_match=obeyed,
            elapsed=len(agent_steps),
            gave_up=self.clock.wait_action and not (obeyed or agent_steps[-1].ended),
            missed_deadlines=missed,
            late_frames=late,
            key_times=key_times,
        )._asdict()

    def _play_random_start(self) -> None:
        count = self.np_random.integers(self._play.random_starts + 1)
        for action in self.np_random.choice(self._game.actions, count):
            self._world.command(int(action))
            agent_step = self._world.finish_agent_step()
            if self._game.over:  # an unlucky start: play from the very beginning instead
                self._game.start_anew(self.np_random)
                self._world.restart()
                return
            if agent_step.terminated:  # a life lost before the episode began does not end it
                self._game.carry_on()
