"""The hands press exactly the commanded keys for all 18 actions, in time and within limits."""

import numpy as np
import pytest

from actors.robots.nao.arms import HOVER, PUSH
from actors.robots.nao.controller import CENTRE, KEY_PLACES, KEY_TOP, TRAVEL, place_of
from actors.robots.nao.kinematics import ArmChain
from actors.robots.nao.posture import FINGERTIP_RADIUS
from actors.robots.nao.robot import Nao
from actors.robots.room.furniture import DESK_TOP
from actors.robots.room.room import FRAME_SUBSTEPS
from common.actions import KEYS_OF_ACTION, Keys

AGENT_STEP = 4
HALF_SECOND = 30
DIRECTIONS = Keys.UP | Keys.DOWN | Keys.LEFT | Keys.RIGHT


def hold(room: Nao, keys: Keys, frames: int) -> list[Keys]:
    room.command(keys)
    return [room.step_frame() for _ in range(frames)]


@pytest.mark.parametrize("action", range(18))
def test_every_action_holds_exactly_its_keys_and_lets_them_go(room: Nao, action: int) -> None:
    room.rest()
    keys = KEYS_OF_ACTION[action]
    assert set(hold(room, keys, HALF_SECOND)[AGENT_STEP - 1 :]) == {keys}
    assert set(hold(room, Keys.NONE, HALF_SECOND)[AGENT_STEP - 1 :]) == {Keys.NONE}


def test_from_any_action_to_any_other_within_two_agent_steps(room: Nao) -> None:
    """The way seldom presses a key of neither action."""
    room.rest()
    frames, strays = [], 0
    for old in KEYS_OF_ACTION:
        for new in KEYS_OF_ACTION:
            if old == new:
                continue
            assert hold(room, old, 3 * AGENT_STEP)[-1] == old
            way = hold(room, new, 3 * AGENT_STEP)
            wrong = [number for number, keys in enumerate(way) if keys != new]
            frames.append(max(wrong, default=-1) + 2)
            strays += any(keys & ~(old | new) for keys in way)
    assert len(frames) == 18 * 17
    assert np.percentile(frames, 50) <= AGENT_STEP
    assert max(frames) <= 2 * AGENT_STEP
    assert strays / len(frames) <= 0.05


def test_a_key_is_pressed_as_soon_after_any_rest(room: Nao) -> None:
    for rest in range(6, 40):
        room.rest()
        hold(room, Keys.LEFT, 8)
        hold(room, Keys.NONE, rest)
        assert hold(room, Keys.RIGHT, 2) == [Keys.NONE, Keys.RIGHT], rest


@pytest.mark.parametrize("keys", [Keys.UP, Keys.DOWN, Keys.LEFT, Keys.RIGHT, Keys.FIRE])
def test_a_key_is_pressed_as_soon_after_a_reset(room: Nao, keys: Keys) -> None:
    """The first command of a game need not lift the finger first."""
    room.rest()
    assert hold(room, keys, 2) == [Keys.NONE, keys]


def test_random_play_pushes_no_key_through_its_stop(room: Nao) -> None:
    room.rest()
    rng = np.random.default_rng(0)
    for action in rng.integers(18, size=200):
        keys = KEYS_OF_ACTION[action]
        assert hold(room, keys, AGENT_STEP)[-1] == keys
        assert room.controller.depths().max() < TRAVEL


def test_rapid_commands_leave_no_finger_caught(room: Nao) -> None:
    """Commands change before they are carried out; then one second is enough for the last one."""
    room.rest()
    rng = np.random.default_rng(2)
    for _ in range(60):
        for action in rng.integers(18, size=4):
            hold(room, KEYS_OF_ACTION[action], int(rng.integers(1, AGENT_STEP)))
        last = KEYS_OF_ACTION[rng.integers(18)]
        assert hold(room, last, 2 * HALF_SECOND)[-1] == last


def test_poses_are_found_once_for_all_robots(room: Nao) -> None:
    other = Nao()
    assert other.arms.left.poses is room.arms.left.poses is not room.arms.right.poses
    other.close()


def test_a_finger_that_is_put_between_two_keys_goes_on(room: Nao) -> None:
    """It is below their tops, at their sides. `test_arms_harm` has one that is caught."""
    room.rest()
    arm = room.arms.left
    chain = ArmChain("L")
    room.command(Keys.UP)
    for _ in range(2 * AGENT_STEP):
        room.step_frame()
    caught = chain.reach(
        room.controller.point(place_of(Keys.DOWN), FINGERTIP_RADIUS - 0.003),
        arm.poses.over[Keys.DOWN],
    )
    for joint, angle in zip(arm.joints, caught, strict=True):
        room._engine.resetJointState(room.body, joint, angle, 0.0)
    assert hold(room, Keys.UP, 2 * HALF_SECOND)[-1] == Keys.UP


@pytest.mark.parametrize("side", ["L", "R"])
def test_poses_are_within_limits_and_put_the_fingertip_on_its_target(room: Nao, side: str) -> None:
    arm = room.arms.left if side == "L" else room.arms.right
    chain = ArmChain(side)
    served = (
        [k for k in KEYS_OF_ACTION if k and k & DIRECTIONS == k] if side == "L" else [Keys.FIRE]
    )
    assert set(arm.poses.on) == set(served)
    assert set(arm.poses.over) == {Keys.NONE, *served}
    for keys in served:
        x, y = place_of(keys)
        for pose, above in ((arm.poses.over[keys], HOVER), (arm.poses.on[keys], -PUSH)):
            top = DESK_TOP + KEY_TOP + above
            expected = (CENTRE[0] + x, CENTRE[1] + y, top + FINGERTIP_RADIUS)
            assert np.linalg.norm(chain.fingertip(pose) - expected) < 0.001
            assert (pose >= chain.lower).all()
            assert (pose <= chain.upper).all()


def test_speeds_and_torques_stay_within_the_published_limits(
    room: Nao, monkeypatch: pytest.MonkeyPatch
) -> None:
    room.rest()
    engine = room._engine
    rng = np.random.default_rng(1)
    fastest, strongest = np.zeros(8), np.zeros(8)
    chains = (room.arms.left, room.arms.right)
    joints = [joint for arm in chains for joint in arm.joints]
    limits = [engine.getJointInfo(room.body, joint) for joint in joints]
    step = room._step

    def watched() -> None:
        nonlocal fastest, strongest
        step()
        states = engine.getJointStates(room.body, joints)
        fastest = np.maximum(fastest, [abs(state[1]) for state in states])
        strongest = np.maximum(strongest, [abs(state[3]) for state in states])

    monkeypatch.setattr(room, "_step", watched)  # between two pictures too
    for _ in range(1_000):
        room.command(KEYS_OF_ACTION[rng.integers(18)])
        for _ in range(AGENT_STEP):
            room.step_frame()
    assert (fastest <= [1.0001 * info[11] for info in limits]).all()
    assert (fastest / [info[11] for info in limits]).max() > 0.95
    assert (strongest <= [1.001 * info[10] for info in limits]).all()
    assert strongest.max() > 0.1


def test_keys_go_down_by_a_fingertips_touch_and_by_nothing_else(room: Nao) -> None:
    room.rest()
    engine, controller = room._engine, room.controller
    link_of = dict(zip(KEY_PLACES, dict(controller.movables), strict=True))
    rng = np.random.default_rng(3)
    pressings = 0
    for frame in range(400):
        if frame % AGENT_STEP == 0:
            room.command(KEYS_OF_ACTION[rng.integers(18)])
        before, touched = controller.held, set()
        room.arms.advance()
        for _ in range(FRAME_SUBSTEPS):
            room._step()
            contacts = engine.getContactPoints(room.body, controller.body)
            touched |= {contact[4] for contact in contacts if contact[9] > 0.0}
        for key in controller.pressed() & ~before:
            assert link_of[key] in touched
            pressings += 1
    assert pressings > 50
