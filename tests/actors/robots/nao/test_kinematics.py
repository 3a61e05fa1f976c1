"""The arms' kinematics agree with the engine's, and inverse with forward kinematics."""

import numpy as np
import pytest

from actors.robots.nao import kinematics
from actors.robots.nao.kinematics import ArmChain, OutOfReach
from actors.robots.nao.posture import FINGERTIP_IN_HAND, HELD_ANGLES
from actors.robots.nao.robot import Nao

START = {"L": np.array([1.15, 0.1, -1.25, -1.2]), "R": np.array([1.15, -0.1, 1.25, 1.2])}


@pytest.mark.parametrize("side", ["L", "R"])
def test_fingertip_is_where_the_engine_has_it(side: str) -> None:
    room = Nao()
    engine = room._engine
    chain = ArmChain(side)
    arm = room.arms.left if side == "L" else room.arms.right
    wrist = engine.getQuaternionFromEuler([HELD_ANGLES[side + "WristYaw"], 0, 0])
    x, y, z = FINGERTIP_IN_HAND
    rng = np.random.default_rng(3)
    for _ in range(10):
        angles = rng.uniform(chain.lower, chain.upper)
        for joint, value in zip(arm.joints, angles, strict=True):
            engine.resetJointState(room.body, joint, value)
        state = engine.getLinkState(room.body, arm.joints[-1], computeForwardKinematics=1)
        in_forearm, _ = engine.multiplyTransforms(
            (0.05595, 0, 0), wrist, (x, y if side == "L" else -y, z), (0, 0, 0, 1)
        )
        expected, _ = engine.multiplyTransforms(state[4], state[5], in_forearm, (0, 0, 0, 1))
        # The engine reports in single precision.
        assert chain.fingertip(angles) == pytest.approx(expected, abs=1e-6)
    room.close()


@pytest.mark.parametrize("side", ["L", "R"])
def test_reach_finds_angles_within_the_limits(side: str) -> None:
    chain = ArmChain(side)
    home = chain.fingertip(START[side])
    rng = np.random.default_rng(4)
    for _ in range(10):
        point = home + rng.uniform(-0.02, 0.02, 3)
        angles = chain.reach(point, START[side])
        assert np.linalg.norm(chain.fingertip(angles) - point) < 1e-5
        assert (angles >= chain.lower).all()
        assert (angles <= chain.upper).all()


@pytest.mark.parametrize("side", ["L", "R"])
def test_of_all_solutions_reach_takes_the_one_nearest_to_its_start(side: str) -> None:
    """Four joints leave one direction in which the fingertip stays: along it the way from the start
    has no part, so no step along it leads nearer."""
    chain = ArmChain(side)
    home = chain.fingertip(START[side])
    rng = np.random.default_rng(5)
    for _ in range(5):
        angles = chain.reach(home + rng.uniform(-0.02, 0.02, 3), START[side])
        slopes = [
            (chain.fingertip(angles + step) - chain.fingertip(angles - step)) / 2e-6
            for step in 1e-6 * np.eye(4)
        ]
        free = np.linalg.svd(np.array(slopes).T)[2][-1]
        away = angles - START[side]
        assert np.linalg.norm(away) > 0.01
        assert abs(free @ away) < 1e-4


def test_a_search_that_ends_beside_the_point_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """After one linear step of 20 mm the fingertip is more than 0.01 mm off."""
    chain = ArmChain("L")
    point = chain.fingertip(START["L"]) + np.array([0.0, 0.0, 0.02])
    chain.reach(point, START["L"])
    monkeypatch.setattr(kinematics, "_STEPS", 1)
    with pytest.raises(OutOfReach, match=r"stays [0-3]\.\d\d mm from"):
        chain.reach(point, START["L"])


def test_a_point_out_of_reach_is_refused() -> None:
    with pytest.raises(OutOfReach, match="mm"):
        ArmChain("L").reach(np.array([0.6, 0.1, 0.3]), START["L"])
