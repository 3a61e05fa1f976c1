"""What takes long to measure of the robotroller, once for all its tests."""

import pytest

from actors.robots.latency import Change, changes
from actors.robots.robotroller.robot import Robotroller


@pytest.fixture(scope="session")
def every_change() -> list[Change]:
    """From every action to every other."""
    robot = Robotroller()
    found = list(changes(robot, 1, 3))
    robot.close()
    return found
