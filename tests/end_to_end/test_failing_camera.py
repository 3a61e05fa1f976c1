"""A camera that fails while the run goes on: the run ends by itself, and says what failed."""

from dataclasses import replace
from itertools import count
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.envs.robot import RobotEnv
from benchmarks.entry_point import add_entry_point
from common.registry import ENVIRONMENTS, Environment
from tests.end_to_end.conftest import SMALL, Program, Stage

FAILS_AT = 700
"""Pictures that a camera takes before."""
SOON = ("--gate-minutes=0.1", "--stream.chunk-steps=2", "--replay.learning-starts=100")
"""A health check may be red for 6 seconds and 320 steps."""


class _Camera:
    """That of a robot, until it fails."""

    def __init__(self, env: RobotEnv) -> None:
        self._take = env.robot.camera_picture
        self._left = FAILS_AT
        self._last = np.zeros(0, np.uint8)

    def freezing(self, screen: NDArray[np.uint8], agent_steps: int = 1) -> NDArray[np.uint8]:
        """The same picture for ever."""
        self._left -= 1
        if self._left >= 0:
            self._last = self._take(screen, agent_steps)
        return self._last

    def stopping(self, screen: NDArray[np.uint8], agent_steps: int = 1) -> NDArray[np.uint8]:
        """Pictures of one moment of the game for ever, each with noise of its own."""
        self._left -= 1
        if self._left >= 0:
            self._last = screen
        return self._take(self._last, agent_steps)

    def darkening(self, screen: NDArray[np.uint8], agent_steps: int = 1) -> NDArray[np.uint8]:
        """All is black within the border."""
        self._left -= 1
        return self._take(screen if self._left >= 0 else np.zeros_like(screen), agent_steps)


def freezing(*given: Any, training: bool) -> RobotEnv:
    env = RobotEnv.of_run(*given, training=training)
    env.robot.camera_picture = _Camera(env).freezing  # type: ignore[method-assign]
    return env


def stopping(*given: Any, training: bool) -> RobotEnv:
    env = RobotEnv.of_run(*given, training=training)
    env.robot.camera_picture = _Camera(env).stopping  # type: ignore[method-assign]
    return env


def darkening(*given: Any, training: bool) -> RobotEnv:
    env = RobotEnv.of_run(*given, training=training)
    env.robot.camera_picture = _Camera(env).darkening  # type: ignore[method-assign]
    return env


_made = count()


def sometimes(*given: Any, training: bool) -> RobotEnv:
    """The camera of every second environment of a process fails."""
    make = freezing if next(_made) % 2 else RobotEnv.of_run
    return make(*given, training=training)


FREEZING, STOPPING, DARKENING, SOMETIMES = (
    replace(ENVIRONMENTS.find("robot"), name=factory.__name__, factory=factory)
    for factory in (freezing, stopping, darkening, sometimes)
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("env", "check"),
    [
        (FREEZING, "following frames"),
        (STOPPING, "following frames"),
        (DARKENING, "valid frames"),
    ],
)
@pytest.mark.parametrize("faults", [(), ("--camera.noise=8", "--camera.glare=0.3")])
def test_a_camera_that_fails_ends_the_run(
    stage: Stage, env: Environment, check: str, faults: tuple[str, ...]
) -> None:
    # More steps than any machine plays before the check has been red for long enough.
    output = _learner(stage, env, "--steps=200000", *faults).ends(3)

    (last,) = (line for line in output.splitlines() if line.startswith("stopped: "))
    assert f"health check '{check}' has been red for 0.1 minutes and 320 steps: " in last
    assert stage.summary()["agent_steps"] >= FAILS_AT + 320


@pytest.mark.slow
def test_one_camera_of_three_that_fails_is_told(stage: Stage) -> None:
    """Two thirds of all frames follow, and the bound of their mean is a half."""
    output = _learner(stage, SOMETIMES, "--envs=3", "--steps=4500").ends()
    told = "HEALTH CHECK RED: faulty environments is 1, not 0: some robots see nothing new, or "
    assert f"{told}press no keys: actor-1" in output.replace("\n", " ")
    assert "following frames" not in output


def _learner(stage: Stage, env: Environment, *more: str) -> Program:
    place = f"{__name__}:{env.name.upper()}"
    add_entry_point(stage.folder, "failing-cameras", "environment", env.name, place)
    own = {flag.partition("=")[0] for flag in SOON}
    small = [flag for flag in SMALL if flag.partition("=")[0] not in own]
    return stage.learner("--local", "--evaluators=0", "--env", env.name, *small, *SOON, *more)
