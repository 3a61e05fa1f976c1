"""The Robotroller: what its servos, its stick and its button do, and what its camera sees."""

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.robots.latency import AGENT_STEP, GOAL, Change, Latency
from actors.robots.robotroller.robot import Robotroller
from actors.robots.room.room import FRAME_SUBSTEPS
from common.actions import KEYS_OF_ACTION, Keys
from common.settings.conditions import PERFECT_CAMERA, CameraConfig, Conditions, PlayConfig

UP, DOWN, LEFT, RIGHT, FIRE = Keys.UP, Keys.DOWN, Keys.LEFT, Keys.RIGHT, Keys.FIRE
GAME = np.full((210, 160, 3), (200, 40, 90), np.uint8)

# Of robotroller.default.json: degrees from the servo's rest, in ticks of 360° / 4096.
PUBLISHED = {
    UP: (0.0, 8.789, 0.0),  # 100 ticks
    DOWN: (0.0, -9.229, 0.0),  # 105
    LEFT: (10.986, 0.0, 0.0),  # 125
    RIGHT: (-6.592, 0.0, 0.0),  # 75
    FIRE: (0.0, 0.0, 5.273),  # 60
    UP | RIGHT | FIRE: (-6.592, 8.789, 5.273),
    Keys.NONE: (0.0, 0.0, 0.0),
}


@pytest.fixture(scope="module")
def robot() -> Iterator[Robotroller]:
    robot = Robotroller()
    yield robot
    robot.close()


def hold(robot: Robotroller, keys: Keys, frames: int) -> list[Keys]:
    robot.command(keys)
    return [robot.step_frame() for _ in range(frames)]


def leans(robot: Robotroller) -> NDArray[np.float64]:
    """Returns how far the stick leans to the left and away, rad, and how far the button is down,
    m, ``float64 [3]``."""
    states = robot._engine.getJointStates(robot.controller.body, robot.controller._joints)
    return np.array([state[0] for state in states])


def servos(robot: Robotroller) -> NDArray[np.float64]:
    """Angles of the servos, °."""
    states = robot._engine.getJointStates(robot.arms.body, robot.arms.joints)
    return np.degrees([state[0] for state in states])


@pytest.mark.parametrize("action", range(18))
def test_every_action_holds_exactly_its_keys_and_lets_them_go(
    robot: Robotroller, action: int
) -> None:
    robot.rest()
    assert hold(robot, KEYS_OF_ACTION[action], 60)[8:] == [KEYS_OF_ACTION[action]] * 52
    assert hold(robot, Keys.NONE, 60)[8:] == [Keys.NONE] * 52


def test_from_any_action_to_any_other_within_two_agent_steps(every_change: list[Change]) -> None:
    latency = Latency.of(every_change)
    assert latency.unreached == 0
    assert latency.p50_ms <= AGENT_STEP * 1000 / 60
    assert max(each.frames or 0 for each in every_change) <= 2 * AGENT_STEP
    # From one side to the other is the farthest way: no servo is there at once.
    across = [each.frames or 0 for each in every_change if (each.old, each.new) == (4, 3)]
    assert np.median(across) >= 2
    assert latency.stray_share <= GOAL.stray_share


@pytest.mark.parametrize("keys", PUBLISHED, ids=str)
def test_servos_turn_to_the_published_positions(robot: Robotroller, keys: Keys) -> None:
    robot.rest()
    hold(robot, keys, 60)
    # The spring and the button push back a little.
    assert servos(robot) == pytest.approx(PUBLISHED[keys], abs=0.05)


def test_servos_are_as_fast_and_as_strong_as_published(robot: Robotroller) -> None:
    """81 revolutions per minute and 0.93 N·m at 5 V."""
    robot.rest()
    rng = np.random.default_rng(1)
    fastest, strongest = np.zeros((2, 3))
    for _ in range(100):
        robot.command(KEYS_OF_ACTION[rng.integers(18)])
        for _ in range(AGENT_STEP):
            robot.arms.advance()
            for _ in range(FRAME_SUBSTEPS):
                robot._step()
                states = robot._engine.getJointStates(robot.arms.body, robot.arms.joints)
                fastest = np.maximum(fastest, [abs(state[1]) for state in states])
                strongest = np.maximum(strongest, [abs(state[3]) for state in states])
    assert fastest == pytest.approx([8.482] * 3, rel=0.01)
    assert strongest == pytest.approx([0.93] * 3, abs=0.001)


def test_the_stick_leans_and_the_button_sinks_only_where_they_are_touched(
    robot: Robotroller,
) -> None:
    robot.rest()
    engine, joystick, arm = robot._engine, robot.controller, robot.arms
    rng = np.random.default_rng(3)
    closings = 0
    for frame in range(300):
        if frame % AGENT_STEP == 0:
            robot.command(KEYS_OF_ACTION[rng.integers(18)])
        before, touched = joystick.held, set()
        robot.arms.advance()
        for _ in range(FRAME_SUBSTEPS):
            robot._step()
            touched |= {
                engine.getJointInfo(joystick.body, contact[4])[12].decode()
                for contact in engine.getContactPoints(arm.body, joystick.body)
                if contact[9] > 0.0
            }
        for key in joystick.pressed() & ~before:
            assert ("cap_touch" if key is FIRE else "stick_touch") in touched
            closings += 1
    assert closings > 30


def test_an_untouched_stick_comes_back_to_the_middle(robot: Robotroller) -> None:
    """What is solid of the arm no longer meets anything."""
    robot.rest()
    hold(robot, UP | LEFT | FIRE, 30)
    assert (leans(robot) > (0.15, 0.12, 0.0015)).all()
    engine, arm = robot._engine, robot.arms.body
    for link in range(engine.getNumJoints(arm)):
        engine.setCollisionFilterGroupMask(arm, link, 0, 0)
    for _ in range(30):
        robot.step_frame()
    assert robot.held == Keys.NONE
    assert np.abs(leans(robot)) == pytest.approx([0.0, 0.0, 0.0], abs=3e-4)
    robot._limit_contacts(arm)
    robot.rest()


def test_switches_close_and_open_at_their_leans(robot: Robotroller) -> None:
    robot.rest()
    joystick, engine = robot.controller, robot._engine
    left_right, up_down, fire = joystick._joints
    held = []
    for lean in (3.9, 4.1, 3.1, 2.9):
        engine.resetJointState(joystick.body, up_down, np.radians(-lean))
        held.append(joystick.pressed())
    assert held == [Keys.NONE, DOWN, DOWN, Keys.NONE]
    held.clear()
    for depth in (0.0013, 0.0015, 0.0009, 0.0007):
        engine.resetJointState(joystick.body, fire, depth)
        held.append(joystick.pressed())
    assert held == [Keys.NONE, FIRE, FIRE, Keys.NONE]
    engine.resetJointState(joystick.body, up_down, np.radians(4.1))
    engine.resetJointState(joystick.body, left_right, np.radians(-4.1))
    assert joystick.pressed() == UP | RIGHT
    engine.resetJointState(joystick.body, left_right, np.radians(4.1))
    engine.resetJointState(joystick.body, fire, 0.0015)
    assert joystick.pressed() == UP | LEFT | FIRE
    robot.rest()
    assert joystick.held == Keys.NONE
    joystick.set_threshold(1.25)
    for lean, depth, keys in ((4.9, 0.0017, Keys.NONE), (5.1, 0.0018, LEFT | FIRE)):
        engine.resetJointState(joystick.body, left_right, np.radians(lean))
        engine.resetJointState(joystick.body, fire, depth)
        assert joystick.pressed() == keys
    joystick.set_threshold(1.0)
    robot.rest()


def test_rest_leaves_nothing_behind_and_two_robots_are_the_same(robot: Robotroller) -> None:
    def trace(each: Robotroller, seed: int) -> list[NDArray[np.float64]]:
        rng = np.random.default_rng(seed)
        found = []
        for action in rng.integers(18, size=20):
            each.command(KEYS_OF_ACTION[action])
            for _ in range(AGENT_STEP):
                each.step_frame()
                found.append(np.concatenate((leans(each), *each.proprioception())))
        return found

    robot.rest()
    first = trace(robot, 1)
    trace(robot, 2)
    robot.rest()
    assert np.array_equal(first, trace(robot, 1))
    other = Robotroller()
    assert np.array_equal(first, trace(other, 1))
    other.close()
    other.close()


def test_proprioception_is_of_the_three_servos(robot: Robotroller) -> None:
    robot.rest()
    angles, speeds = robot.proprioception()
    assert (*angles, *speeds) == pytest.approx([0.0] * 6, abs=1e-3)
    hold(robot, LEFT | DOWN | FIRE, 1)
    angles, speeds = robot.proprioception()
    assert (np.sign(angles) == (1, -1, 1)).all()
    assert (np.abs(speeds) > 0.2).all()
    hold(robot, LEFT | DOWN | FIRE, 30)
    angles, speeds = robot.proprioception()
    assert angles == pytest.approx([10.99 / 12.5, -9.23 / 12.5, 5.27 / 12.5], abs=0.01)
    assert speeds == pytest.approx([0.0] * 3, abs=0.02)


@pytest.mark.parametrize("arm_speed", [0.25, 1.1])
@pytest.mark.parametrize("key_threshold", [0.5, 1.4])
def test_slow_arms_and_stiff_keys_reach_all(arm_speed: float, key_threshold: float) -> None:
    robot = Robotroller(play=PlayConfig(arm_speed=arm_speed, key_threshold=key_threshold))
    frames = []
    for keys in KEYS_OF_ACTION:
        held = hold(robot, keys, 24)
        assert held[-1] == keys
        frames.append(sum(each != keys for each in held))
    assert (np.mean(frames) > 2) == (arm_speed == 0.25)
    robot.close()


def test_its_camera_sees_the_whole_picture_and_nothing_of_the_arm(robot: Robotroller) -> None:
    robot.rest()
    renderings = []
    for keys in KEYS_OF_ACTION:
        hold(robot, keys, 4)
        picture = robot.picture(GAME)
        renderings.append(robot.view_of_robot.rendering())
    assert all(each is renderings[0] for each in renderings)
    assert picture[120, 160].tolist() == [200, 40, 90]
    full = robot.view_of_robot.camera.render()
    assert np.array_equal(robot.view_of_robot.rendering().rgb, full.rgb)
    assert not np.isin(full.bodies, (robot.arms.body, robot.controller.body)).any()
    for yaw in (-10, 10):
        for pitch in (-10, 10):
            robot.set_eye(CameraConfig(yaw=yaw, pitch=pitch, screen_distance=0.85))
            x, y = robot.true_corners().T
            assert (x > 0).all()
            assert (x < 319).all()
            assert (y > 0).all()
            assert (y < 239).all()
    robot.set_eye(PERFECT_CAMERA)


@pytest.mark.parametrize("keys", [UP, LEFT, FIRE])
def test_a_camera_that_looks_down_sees_the_arm_move(robot: Robotroller, keys: Keys) -> None:
    robot.rest()
    engine = robot._engine
    moves = [(body, link) for body, moving in robot._moves.items() for link, _ in moving]
    parts = {engine.getJointInfo(*each)[12] for each in moves}
    assert parts == {b"ring", b"arch", b"finger", b"stick", b"cap"}
    robot.set_eye(CameraConfig(pitch=30.0))
    still = robot.view_of_robot.rendering()
    assert np.isin(still.bodies, robot.arms.body).any()
    hold(robot, keys, 8)
    seen, full = robot.view_of_robot.rendering(), robot.view_of_robot.camera.render()
    assert np.array_equal(seen.rgb, full.rgb)
    assert (seen.rgb != still.rgb).any()
    robot.set_eye(PERFECT_CAMERA)


def test_each_games_conditions_are_those_of_any_room() -> None:
    robot = Robotroller()
    usual = robot.camera_picture(GAME)
    slow = Conditions(
        PlayConfig(arm_speed=0.25, key_threshold=1.4),
        CameraConfig(noise=8.0, yaw=5.0, screen_distance=1.1, ambient=0.2),
    )
    robot.begin_game(slow, np.random.default_rng(0))
    robot.rest()
    assert (robot.camera_picture(GAME) != usual).mean() > 0.5
    assert hold(robot, LEFT, 2) == [Keys.NONE] * 2
    robot.begin_game(Conditions(PlayConfig(), PERFECT_CAMERA), np.random.default_rng(0))
    robot.rest()
    assert np.array_equal(robot.camera_picture(GAME), usual)
    assert hold(robot, LEFT, 2)[-1] == LEFT
    robot.close()


def test_people_see_it_and_its_pressed_keys(robot: Robotroller) -> None:
    robot.rest()

    def green() -> int:
        view = robot.view(GAME, 320, 240, "hands").astype(int)
        others = np.maximum(view[:, :, 0], view[:, :, 2])
        return int((view[:, :, 1] > others + 60).sum())

    assert green() == 0
    hold(robot, UP, 8)
    one = green()
    hold(robot, UP | LEFT | FIRE, 8)
    assert 20 < one < green() / 2
    robot.rest()
    assert green() == 0
    room = robot.view(GAME, 320, 240)
    assert (room == (200, 40, 90)).all(axis=2).mean() > 0.03
    front = robot.view(GAME, 320, 240, "front")
    assert (front != room).any()
    ends = front[5, -5].astype(int)  # past the room, as if its wall went on; white stands out
    assert abs(ends - room[5, 5]).max() <= 10
