"""Rapid commands and blocked hands do not break the physics."""

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.robots.nao.arms import PATIENCE, Arm
from actors.robots.nao.controller import BOX, CENTRE, CROSS_MIDDLE, KEY_TOP, TRAVEL
from actors.robots.nao.kinematics import ArmChain
from actors.robots.nao.posture import FINGERTIP_RADIUS
from actors.robots.nao.robot import Nao
from actors.robots.room.furniture import DESK_TOP
from actors.robots.room.room import FRAME_SUBSTEPS
from common.actions import KEYS_OF_ACTION, Keys

SECOND = 60
BOX_TOP = DESK_TOP + BOX[2]


@pytest.fixture
def room() -> Iterator[Nao]:
    room = Nao()
    yield room
    room.close()


def lowest_point(room: Nao, arm: Arm) -> float:
    """Returns the height of the fingertip's underside in the room, m."""
    states = room._engine.getJointStates(room.body, arm.joints)
    tip = arm.chain.fingertip(np.array([state[0] for state in states]))
    return float(tip[2]) - FINGERTIP_RADIUS


def speeds(room: Nao) -> NDArray[np.float64]:
    """Returns the moving joints' speeds as shares of their published maximum."""
    return np.abs(room.arms.posture()[1])


def motion_energy(room: Nao) -> float:
    """Returns the kinetic energy of the robot's links, J, without rotation."""
    engine = room._engine
    links = range(engine.getNumJoints(room.body))
    states = engine.getLinkStates(room.body, list(links), computeLinkVelocity=1)
    masses: list[float] = [engine.getDynamicsInfo(room.body, link)[0] for link in links]
    return sum(
        mass * float(np.square(state[6]).sum()) / 2
        for mass, state in zip(masses, states, strict=True)
    )


@pytest.mark.parametrize("most_frames", [1, 2, 3, 6])
def test_rapid_commands_push_no_finger_through_a_key_and_no_key_through_its_stop(
    room: Nao, most_frames: int
) -> None:
    """Random commands come every 1 to ``most_frames`` frames, far more often than in play."""
    room.rest()
    rng = np.random.default_rng(most_frames)
    left = 0
    for _ in range(10 * SECOND):
        if not left:
            room.command(KEYS_OF_ACTION[rng.integers(18)])
            left = int(rng.integers(1, most_frames + 1))
        left -= 1
        room.arms.advance()
        for _ in range(FRAME_SUBSTEPS):
            room._step()
            # A finger that slides against a neighbour's side can push it beyond for one step.
            assert room.controller.depths().max() < TRAVEL + 0.002
            # A key at its stop is level with the box.
            for arm in (room.arms.left, room.arms.right):
                assert lowest_point(room, arm) > BOX_TOP - 0.0003
        room.controller.pressed()
        assert room.controller.depths().max() < TRAVEL + 0.0003


def hold_back(room: Nao, frames: int, seed: int, above: float = 0.0) -> float:
    """Plays randomly, checks bounds that hold whatever the obstacle, and returns the maximum
    energy, J.

    The left fingertip stays above the height ``above``, m; if that is over the keys, they stay
    released.
    """
    rng = np.random.default_rng(seed)
    most = 0.0
    for frame in range(frames):
        if frame % 4 == 0:
            room.command(KEYS_OF_ACTION[rng.integers(18)])
        pressed = room.step_frame()
        assert speeds(room).max() < 1.2
        assert lowest_point(room, room.arms.left) > above
        assert above < DESK_TOP + KEY_TOP or pressed & ~Keys.FIRE == Keys.NONE
        most = max(most, motion_energy(room))
    return most


def recovers(room: Nao) -> bool:
    """Whether the hands work normally after one second to get free."""
    for keys in (Keys.NONE, Keys.UP | Keys.LEFT | Keys.FIRE, Keys.DOWN, Keys.NONE):
        room.command(keys)
        if [room.step_frame() for _ in range(SECOND)][-1] != keys:
            return False
    return bool(speeds(room).max() < 0.01)


def plate(room: Nao, middle: tuple[float, float, float], half: tuple[float, float, float]) -> int:
    """Adds a static box."""
    engine = room._engine
    shape = engine.createCollisionShape(engine.GEOM_BOX, halfExtents=half)
    return int(engine.createMultiBody(0.0, shape, basePosition=middle))


def test_a_plate_over_the_keys_is_not_passed_and_does_no_harm(room: Nao) -> None:
    room.rest()
    free = hold_back(room, 2 * SECOND, 0)
    room.rest()
    under = DESK_TOP + KEY_TOP + 0.0002
    x, y = CENTRE[0] + CROSS_MIDDLE[0], CENTRE[1] + CROSS_MIDDLE[1]
    body = plate(room, (x, y, under + 0.0005), (0.02, 0.02, 0.0005))
    assert hold_back(room, 5 * SECOND, 1, above=under + 0.0005) < 4 * free
    room._engine.removeBody(body)
    assert recovers(room)


@pytest.mark.parametrize(("old", "new"), [(Keys.LEFT, Keys.RIGHT), (Keys.RIGHT, Keys.LEFT)])
def test_a_finger_that_is_caught_at_a_wall_climbs_over_it(room: Nao, old: Keys, new: Keys) -> None:
    """The usual way is 1.5 mm + 0.5 · (1.5 mm + 3.2 mm) = 3.9 mm above the keys; the wall is 8 mm
    high. The way of a caught finger is 1.5 mm + 2 · 4.7 mm = 10.9 mm above them."""
    room.rest()
    room.command(old)
    assert [room.step_frame() for _ in range(10)][-1] == old
    bottom, top = DESK_TOP + KEY_TOP + 0.001, DESK_TOP + KEY_TOP + 0.008
    x, y = CENTRE[0] + CROSS_MIDDLE[0], CENTRE[1] + CROSS_MIDDLE[1]
    plate(room, (x, y, (bottom + top) / 2), (0.03, 0.0005, (top - bottom) / 2))
    room.command(new)
    way = [room.step_frame() for _ in range(SECOND // 2)]
    assert set(way[4:PATIENCE]) == {Keys.NONE}  # no key is pressed this side of the wall
    assert way[-1] == new


def test_a_box_that_stands_in_a_fingertip_pushes_it_out_gently(room: Nao) -> None:
    """A sudden overlap of 3 mm is worse than anything in play."""
    room.rest()
    free = hold_back(room, 2 * SECOND, 0)
    room.rest()
    chain = ArmChain("L")
    tip = chain.fingertip(room.arms.left.poses.over[Keys.NONE])
    top = float(tip[2]) - FINGERTIP_RADIUS + 0.003
    body = plate(room, (float(tip[0]), float(tip[1]), top - 0.001), (0.02, 0.02, 0.001))
    assert hold_back(room, 5 * SECOND, 2) < 4 * free
    room._engine.removeBody(body)
    assert recovers(room)


def test_a_hand_that_is_held_fast_pulls_and_lets_go(room: Nao) -> None:
    room.rest()
    free = hold_back(room, 2 * SECOND, 0)
    room.rest()
    engine, arm = room._engine, room.arms.left
    position, turn = engine.getLinkState(room.body, arm.joints[-1], computeForwardKinematics=1)[:2]
    hold = engine.createConstraint(
        room.body, arm.joints[-1], -1, -1, engine.JOINT_FIXED, (0, 0, 0), (0, 0, 0), position,
        (0, 0, 0, 1), turn,
    )  # fmt: skip
    engine.changeConstraint(hold, maxForce=500)
    before = lowest_point(room, arm)
    assert hold_back(room, 5 * SECOND, 3) < 4 * free
    assert abs(lowest_point(room, arm) - before) < 0.005
    engine.removeConstraint(hold)
    assert recovers(room)
