"""Observes an environment: gathers all that can be shown after a step into a snapshot."""

from contextlib import nullcontext
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from actors.envs.ale import AtariEnv
from actors.envs.robot import RobotEnv
from actors.loop import Step
from actors.robots.nao.own_nao import OwnNao
from actors.robots.nao.room import Room
from common.actions import KEYS_OF_ACTION
from common.errors import InputError
from common.run.config import PlayConfig
from viewer.panels import PANEL
from viewer.snapshot import RobotSnapshot, Snapshot


class Observer:
    """Observes one environment.

    Args:
        play: the environment's settings.
        outside_every: snapshots per rendering of the whole room, which takes more time than all
            else; the game on its screen is always new.
        nao_urdf: another NAO to show in place of the one that plays, see `OwnNao`.

    Raises:
        InputError: that robot cannot be shown, or no NAO plays.
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
        self._taken = 0
        self._outside_every = outside_every
        emulator = env.emulator
        self._actions = emulator.minimal_actions if play.minimal_actions else tuple(range(18))
        self._own_nao: OwnNao | None = None
        if isinstance(env, RobotEnv):
            self._view = env.robot.view
        if nao_urdf is not None:
            room = env.robot if isinstance(env, RobotEnv) else None
            if not isinstance(room, Room):
                raise InputError("--nao-urdf shows another NAO, but no NAO plays here: omit it.")
            self._own_nao = OwnNao(nao_urdf, emulator.screen_shape)
            self._view = partial(self._own_nao.view, room)

    def look(self, step: Step, values: NDArray[np.float32] | None) -> Snapshot:
        """Returns what there is to see after ``step``, whose action was chosen by Q-values
        ``values``."""
        # All of one moment: a world in real time would go on from picture to picture.
        with self._env.still() if isinstance(self._env, RobotEnv) else nullcontext():
            return self._snapshot(step, values)

    def _snapshot(self, step: Step, values: NDArray[np.float32] | None) -> Snapshot:
        screen = self._env.emulator.screen_rgb()
        wanted = pressed = KEYS_OF_ACTION[self._actions[step.a_tm1]]
        robot = None
        if isinstance(self._env, RobotEnv):
            wanted, pressed = self._env.wanted, self._env.pressed
            robot = self._robot_snapshot(self._env, screen)
        return Snapshot(
            game=self._env.emulator.game,
            score=step.info.game_score,
            step=step.info.game_steps,
            screen=screen,
            frame=step.s_t[-1],
            wanted=wanted,
            pressed=pressed,
            actions=self._actions,
            chosen=step.a_tm1,
            values=values,
            robot=robot,
        )

    def _robot_snapshot(self, env: RobotEnv, screen: NDArray[np.uint8]) -> RobotSnapshot:
        moved = self._taken % self._outside_every == 0
        self._taken += 1
        return RobotSnapshot(
            outside=self._view(screen, *PANEL, "room", moved=moved),
            camera=env.seen,
            corners=env.detection.corners,
            found=env.detection.valid,
            controller=self._view(screen, *PANEL, "hands"),
        )

    def close(self) -> None:
        """Close what shows another NAO; the environment stays open."""
        if self._own_nao is not None:
            self._own_nao.close()
