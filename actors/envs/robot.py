"""ALE-Robot: the agent behind a robot's camera and hands (figure 1 of 2017).

It knows only the `Robot` protocol, and `ClockConfig` says how its time passes.
"""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any, Self

import gymnasium
import numpy as np
from numpy.typing import NDArray

from actors.envs.clock import Clock, Lockstep, RealTime
from actors.envs.emulator import Emulator
from actors.envs.game import DEFAULT_PLAY, AtariGame
from actors.envs.observation import FrameStack, Observation, observation_space, shrink
from actors.envs.step_info import StepInfo
from actors.envs.world import AgentStep, World
from actors.robots.interface import Robot, ViewName
from actors.vision.screen_detector import Detection, ScreenDetector
from common.actions import Keys
from common.proprioception import vector_width
from common.registry import ROBOTS
from common.run.clock import ClockConfig
from common.run.config import CameraConfig, PlayConfig, RunConfig

LOCKSTEP = ClockConfig()
DEFAULT_CAMERA = CameraConfig()


class RobotEnv(gymnasium.Env[Observation, np.int64]):
    """One step is one agent step of ``play.frame_skip`` emulator frames, 1/60 s each.

    An action sends the hands to its keys; before every emulator frame the physics goes on and
    the controller is read, and the keys that are then really pressed are what the game gets. The
    state's frames come from the robot's camera only. Spaces, rewards, episodes and ``info``
    (`StepInfo`) are those of `AtariEnv`, so that the two can be compared.

    A step takes several agent steps where the agent waits for its keys or, in real time, was too
    slow; its reward is then their points discounted by the time that had passed, so that
    ``reward + discount ** info["elapsed"] * value`` is the return.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 15}  # noqa: RUF012

    def __init__(
        self,
        game: str = "pong",
        *,
        play: PlayConfig = DEFAULT_PLAY,
        camera: CameraConfig = DEFAULT_CAMERA,
        clock: ClockConfig = LOCKSTEP,
        training: bool = False,
        discount: float = 1.0,
        clip_rewards: bool = False,
        render_mode: str | None = None,
    ) -> None:
        """Sit ``play.robot`` down at its desk.

        Args:
            discount: γ per agent step, within steps of several agent steps.
            clip_rewards: count each agent step's points as -1 to 1. Scores stay as they are.

        Raises:
            InputError: there is no such robot, or ale-py does not bundle the game.
        """
        self.metadata = {**self.metadata, "render_fps": 60 / play.frame_skip}
        self.render_mode = render_mode
        self.clock = clock
        self._play = play
        # The random start is not the emulator's here: it goes through the hands, see `reset`.
        self._game = AtariGame(game, replace(play, random_starts=0), training=training)
        self._camera = camera
        self.robot: Robot = ROBOTS.make(play.robot, self._game.emulator.screen_shape, camera, play)
        """The robot and all around it."""
        self.detector = ScreenDetector(camera.distortion)
        """Replaced at each new game: do not keep it."""
        # Drawing takes a tenth of an agent step: not where only a person might look at the picture.
        # A late camera has to be asked each time, or it has no earlier picture to give.
        self._looks = play.eye == "camera" or camera.latency > 0
        self._seen: NDArray[np.uint8] | None = None
        self._unseen = 0
        """Agent steps since the last picture was taken."""
        self.detection: Detection
        """The game as detected in the last picture."""
        joints = ROBOTS.find(play.robot).joints
        self._world = World(self.robot, joints, self._game, play)
        self._clock: Clock = (
            Lockstep(self._world) if clock.sync else RealTime(self._world, clock.speed)
        )
        self._most_agent_steps = play.wait_bound if clock.wait_action else 1
        self._discount = discount
        self._clip_rewards = clip_rewards
        self._late_frames = 0
        self._frames = FrameStack(play.frame_stack)
        self.action_space = gymnasium.spaces.Discrete(len(self._game.actions))
        self.observation_space = observation_space(play, vector_width(joints))

    @classmethod
    def of_run(cls, config: RunConfig, clock: ClockConfig, *, training: bool) -> Self:
        """Returns the environment of a run."""
        return cls(
            config.game,
            play=config.play,
            camera=config.camera,
            clock=clock,
            training=training,
            discount=config.learning.discount,
            clip_rewards=config.learning.clip_rewards,
        )

    @property
    def emulator(self) -> Emulator:
        """The console; another one after a reset with a seed."""
        return self._game.emulator

    def still(self) -> AbstractContextManager[object]:
        """While it is entered the world stands still, to be looked at."""
        return self._clock.still()

    @property
    def seen(self) -> NDArray[np.uint8]:
        """The camera's last picture, ``[240, 320, 3]``."""
        if self._seen is None:
            with self._clock.still():
                self._seen = self._picture()
        return self._seen

    @property
    def wanted(self) -> Keys:
        """The keys of the last command."""
        return self._world.wanted

    @property
    def pressed(self) -> Keys:
        """The keys that the game was given last."""
        return self._world.pressed

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; its first state is what is seen first, repeated.

        A new game begins with the hands at rest and up to ``play.random_starts`` random
        agent steps; a game that goes on after a lost life leaves everything as it is. No game time
        passes between two episodes, not even in real time, and the random start is played as fast
        as the machine goes.
        """
        super().reset(seed=seed)
        self._clock.stop()
        if self._game.begin_episode(
            self.np_random,
            seeded=seed is not None,
            new_game=bool((options or {}).get("new_game", False)),
        ):
            self._world.restart()
            self.robot.begin_game(self.np_random)
            # Nothing of an earlier game may show in a seeded one, not even where the screen was.
            self.detector = ScreenDetector(self._camera.distortion)
            self._play_random_start()
        self._photograph(0)
        self._look()
        self._frames.restart(self.detection.frame)
        observation, info = self._observation(), self._info([], 0, ())
        self._clock.start()
        return observation, info

    def step(self, action: np.int64 | int) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Let the hands set out for the action's keys, and let time pass."""
        agent_steps = self._clock.command(self._game.action(action))
        missed = len(agent_steps)
        photographed = 0
        while not agent_steps or not agent_steps[-1].ended:
            agent_steps += self._clock.pass_agent_step()
            if self._obeyed(agent_steps[-1]) or len(agent_steps) - missed >= self._most_agent_steps:
                break
            if self._camera.latency > 0:  # a late picture may be one from the middle of a step
                with self._clock.still():
                    self._photograph(len(agent_steps) - photographed)
                photographed = len(agent_steps)
        last = agent_steps[-1]
        if not self.clock.wait_action:
            missed = max(missed, len(agent_steps) - 1)
        with self._clock.still():
            self._photograph(len(agent_steps) - photographed)
            self._look()
            self._frames.push(self.detection.frame)
            info = self._info(agent_steps, missed, self._world.key_watch.take())
            return (
                self._observation(),
                self._reward(agent_steps),
                last.terminated,
                last.truncated,
                info,
            )

    def render(self) -> NDArray[np.uint8] | None:
        """The room from outside, ``uint8 [480, 640, 3]``, for render_mode "rgb_array"."""
        return self.view(640, 480) if self.render_mode == "rgb_array" else None

    def view(
        self, width: int, height: int, viewpoint: ViewName = "room", *, moved: bool = True
    ) -> NDArray[np.uint8]:
        """The robot from outside as in `Robot.view`, ``uint8 [height, width, 3]``."""
        with self._clock.still():
            screen = self._game.emulator.screen_rgb()
            return self.robot.view(screen, width, height, viewpoint, moved=moved)

    def close(self) -> None:
        """End the clock and the physics."""
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
            keys_match=obeyed,
            elapsed=len(agent_steps),
            gave_up=self.clock.wait_action and not (obeyed or agent_steps[-1].ended),
            missed_deadlines=missed,
            late_frames=late,
            key_times=key_times,
        )._asdict()

    def _photograph(self, agent_steps: int) -> None:
        """Take a picture; ``agent_steps`` have passed since the last time."""
        self._unseen += agent_steps
        self._seen = self._picture() if self._looks else None

    def _picture(self) -> NDArray[np.uint8]:
        passed, self._unseen = self._unseen, 0
        return self.robot.camera_picture(self._game.emulator.screen_rgb(), passed)

    def _look(self) -> None:
        if self._play.eye == "camera":
            self.detection = self.detector.detect(self.seen)
        else:
            self.detection = Detection(shrink(self._game.emulator.screen_grey()), True, None)

    def _observation(self) -> Observation:
        vector = self._world.vector()
        frames = self._frames.state
        return frames if vector is None else {"frames": frames, "vector": vector}

    def _play_random_start(self) -> None:
        count = self.np_random.integers(self._play.random_starts + 1)
        for action in self.np_random.choice(self._game.actions, count):
            self._world.command(int(action))
            agent_step = self._world.finish_agent_step()
            if self._game.over:  # an unlucky start: play from the very beginning instead
                self._game.begin_episode(self.np_random, seeded=False, new_game=True)
                self._world.restart()
                return
            if agent_step.terminated:  # a life lost before the episode began does not end it
                self._game.begin_episode(self.np_random, seeded=False, new_game=False)
