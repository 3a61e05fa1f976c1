"""ALE-Robot: the agent plays through a robot's camera and hands (figure 1 of 2017).

It knows robots only by the `Robot` protocol; `ClockConfig` says how time passes.
"""

from collections import deque
from collections.abc import Sequence
from contextlib import AbstractContextManager
from functools import partial
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from actors.envs.clock import Clock, Lockstep, RealTime
from actors.envs.game import AtariGame
from actors.envs.game_env import GameEnv
from actors.envs.observation import Observation, shrink
from actors.envs.phosphor import luminance
from actors.envs.step_info import StepInfo
from actors.envs.world import AgentStep, World
from actors.robots.interface import Robot, ViewName
from actors.vision.screen_detector import Detection, ScreenDetector, is_blank
from common.protocol.step_fields import FRAME_SHAPE
from common.registry import ROBOTS
from common.run.clock import ClockConfig
from common.run.conditions import DEFAULT_PLAY, PERFECT_CAMERA, CameraConfig, PlayConfig
from common.run.config import RunConfig
from common.run.ranges import NOTHING_DRAWN, RandomiseConfig

_UNSEEN = Detection(np.zeros(FRAME_SHAPE, np.uint8), False, None)
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
        world = World(self.robot, console, play, joints, self.robot.proprioception)
        super().__init__(console, world, play, render_mode, joints)
        self.detector = ScreenDetector(camera.distortion)
        """The screen detector. Do not keep it: each new game replaces it."""
        self._seen: NDArray[np.uint8] | None = None
        self._shown: deque[NDArray[np.uint8]] = deque(maxlen=1)
        """The game's own pictures since that which the camera's last picture shows, oldest first.
        """
        self._shown_before = np.zeros(0, np.uint8)
        """The oldest of them at the detection before."""
        self._unseen = 0
        """Agent steps since the last picture was taken."""
        self.detection = _UNSEEN
        """The game as detected in the last picture."""
        self._follows = True
        """Whether the frame changed since the last detection, or the game's own picture did not."""
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

    @property
    def seen(self) -> NDArray[np.uint8]:
        """The camera's last picture, ``[240, 320, 3]``."""
        if self._seen is None:
            with self.still():
                self._seen = self._picture()
        return self._seen

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
            # A seeded game may know nothing of an earlier one, not even where the screen was.
            self.detector = ScreenDetector(self.conditions.camera.distortion)
            if self._play.eye == "camera":
                look = partial(self.robot.camera_picture, agent_steps=1)
                begin = partial(self.robot.begin_game, self.conditions, self.np_random)
                self._time_eye(look, (*self.emulator.screen_shape, 3), forget=begin)
            self._play_random_start()
            self._world.key_watch.disregard()  # no policy gave the commands of the random start
            self._shown = deque(maxlen=self.conditions.camera.latency + 1)
        self._photograph(0)
        self._detect()
        self._frames.restart(self.detection.frame)
        observation, info = self._observation(), self._info([], 0, ())
        self._clock.start()
        return observation, info

    def step(self, action: np.int64 | int) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Sends the hands to the action's keys, and lets time pass."""
        # Time passes only while the clock waits, so that all that is told is of the step's end.
        with self.still():
            agent_steps = self._clock.command(self._game.action(action))
            missed = len(agent_steps)
            photographed = 0
            while not agent_steps or not agent_steps[-1].ended:
                agent_steps += self._clock.pass_agent_step()
                waited = len(agent_steps) - missed
                if self._obeyed(agent_steps[-1]) or waited >= self._most_agent_steps:
                    break
                if self._needs_each_picture:
                    self._photograph(len(agent_steps) - photographed)
                    photographed = len(agent_steps)
            last = agent_steps[-1]
            # Unless the agent waits, the command is for one agent step, and later ones are missed.
            obeying = agent_steps[missed : None if self.clock.wait_action else missed + 1]
            kept = sum(not agent_step.late for agent_step in obeying)
            self._photograph(len(agent_steps) - photographed)
            self._detect()
            self._frames.push(self.detection.frame)
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
            frame_follows=self._follows,
            keys_match=obeyed,
            elapsed=len(agent_steps),
            gave_up=self.clock.wait_action and not (obeyed or agent_steps[-1].ended),
            missed_deadlines=missed,
            late_frames=late,
            key_times=key_times,
        )._asdict()

    @property
    def _needs_each_picture(self) -> bool:
        """Whether a later picture may be one that was taken at this agent step."""
        camera = self.conditions.camera
        return camera.latency > 0 or camera.dropped > 0

    def _photograph(self, agent_steps: int) -> None:
        """Takes a picture; ``agent_steps`` have passed since the last time."""
        self._unseen += agent_steps
        # Drawing takes a tenth of an agent step, so it is skipped where only a person might look.
        looks = self._play.eye == "camera" or self._needs_each_picture
        self._seen = self._picture() if looks else None

    def _picture(self) -> NDArray[np.uint8]:
        passed, self._unseen = self._unseen, 0
        screen = self.emulator.screen_rgb()
        if passed == 0 and self._shown:
            self._shown.pop()  # a picture of the same moment
        self._shown.append(screen)
        return self.robot.camera_picture(screen, passed)

    def _detect(self) -> None:
        if self._play.eye == "camera":
            before, self.detection = self.detection, self.detector.detect(self.seen)
            shown = self._shown[0]
            if is_blank(self.detection.frame) and not is_blank(shrink(luminance(shown))):
                # The border is in place, but the game in it cannot be seen.
                self.detection = self.detection._replace(valid=False)
            changed = not np.array_equal(before.frame, self.detection.frame)
            self._follows = changed or np.array_equal(shown, self._shown_before)
            self._shown_before = shown
        else:
            self.detection = Detection(shrink(self.emulator.screen_grey()), True, None)

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
