"""Takes the glances: goes round an environment after a step and gathers what can be shown."""

from contextlib import nullcontext
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from actors.envs.ale import AtariEnv
from actors.envs.robot import RobotEnv
from actors.loop import Step
from actors.robots.nao.viewpoint import CLOSE_UP, VISITOR, Viewpoint
from common.actions import KEYS_OF_ACTION
from common.run.config import PlayConfig
from viewer.own_nao import OwnNao
from viewer.panels import PANEL
from viewer.snapshot import Glance, RobotGlance


class Onlooker:
    """Looks at one environment.

    Args:
        play: the environment's settings.
        outside_every: render the whole room only at each so many glances, because that takes more
            time than all else; the game on its screen is always new.
        nao_urdf: a robot to show in ours' place, see `OwnNao`.

    Raises:
        InputError: that robot cannot be shown.
    """

    def __init__(
        self,
        env: RobotEnv | AtariEnv,
        play: PlayConfig,
        nao_urdf: Path | None = None,
        *,
        outside_every: int = 1,
    ) -> None:
        self._env = env
        self._glances = 0
        self._outside_every = outside_every
        emulator = env.emulator
        self._actions = emulator.minimal_actions if play.minimal_actions else tuple(range(18))
        self._own_nao = None if nao_urdf is None else OwnNao(nao_urdf, emulator.screen_shape)

    def look(self, step: Step, values: NDArray[np.float32] | None) -> Glance:
        """What there is to see after ``step``, whose action was chosen by Q-values ``values``."""
        # All of one moment: a world in real time would go on from picture to picture.
        with self._env.still() if isinstance(self._env, RobotEnv) else nullcontext():
            return self._glance(step, values)

    def _glance(self, step: Step, values: NDArray[np.float32] | None) -> Glance:
        screen = self._env.emulator.screen_rgb()
        wanted = pressed = KEYS_OF_ACTION[self._actions[step.a_tm1]]
        robot = None
        if isinstance(self._env, RobotEnv):
            wanted, pressed = self._env.wanted, self._env.pressed
            robot = self._look_at_robot(self._env, screen)
        return Glance(
            game=self._env.emulator.game,
            score=float(step.info["game_score"]),
            step=int(step.info["game_steps"]),
            screen=screen,
            frame=step.s_t[-1],
            wanted=wanted,
            pressed=pressed,
            actions=self._actions,
            chosen=step.a_tm1,
            values=values,
            robot=robot,
        )

    def _look_at_robot(self, env: RobotEnv, screen: NDArray[np.uint8]) -> RobotGlance:
        moved = self._glances % self._outside_every == 0
        self._glances += 1
        return RobotGlance(
            outside=self._view(env, screen, VISITOR, moved=moved),
            camera=env.seen,
            corners=env.detection.corners,
            found=env.detection.valid,
            controller=self._view(env, screen, CLOSE_UP),
        )

    def _view(
        self,
        env: RobotEnv,
        screen: NDArray[np.uint8],
        viewpoint: Viewpoint,
        *,
        moved: bool = True,
    ) -> NDArray[np.uint8]:
        if self._own_nao is None:
            return env.room.view(screen, *PANEL, viewpoint, moved=moved)
        return self._own_nao.view(env.room, screen, *PANEL, viewpoint, moved=moved)

    def close(self) -> None:
        """Leave; the environment stays open."""
        if self._own_nao is not None:
            self._own_nao.close()
