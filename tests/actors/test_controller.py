"""The keys: springs, travel, threshold and hysteresis, and room for one fingertip."""

import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from actors.nao.controller import (
    KEY_PITCH,
    KEY_PLACES,
    PRESS_DEPTH,
    RELEASE_DEPTH,
    SPRING_FORCE,
    TRAVEL,
    Controller,
    place_of,
)
from actors.nao.posture import FINGERTIP_RADIUS
from actors.nao.room import BulletClient, pybullet
from common.actions import KEYS_OF_ACTION, Keys

DIRECTIONS = Keys.UP | Keys.DOWN | Keys.LEFT | Keys.RIGHT


@pytest.fixture
def engine() -> Iterator[BulletClient]:
    engine = BulletClient(pybullet.DIRECT)
    engine.setGravity(0, 0, -9.81)
    engine.setPhysicsEngineParameter(fixedTimeStep=1 / 240)
    yield engine
    engine.disconnect()


@pytest.fixture
def controller(engine: BulletClient, tmp_path: Path) -> Controller:
    return Controller(engine, tmp_path, 0.2)


def push(engine: BulletClient, controller: Controller, key: Keys, newton: float) -> Keys:
    """Push one key down for half a second."""
    link = controller.links[list(KEY_PLACES).index(key)]
    for _ in range(120):
        engine.applyExternalForce(
            controller.body, link, (0, 0, -newton), (0, 0, 0), engine.LINK_FRAME
        )
        engine.stepSimulation()
    return controller.pressed()


@pytest.mark.parametrize("key", list(KEY_PLACES))
def test_a_key_needs_more_than_its_spring(
    engine: BulletClient, controller: Controller, key: Keys
) -> None:
    assert push(engine, controller, key, 0.7 * SPRING_FORCE) == Keys.NONE
    assert push(engine, controller, key, 1.5 * SPRING_FORCE) == key
    assert push(engine, controller, key, 0.0) == Keys.NONE
    assert controller.depths().max() < 0.0003


def test_a_key_stops_at_the_end_of_its_travel(
    engine: BulletClient, controller: Controller
) -> None:
    push(engine, controller, Keys.UP, 5.0)
    assert controller.depths()[0] == pytest.approx(TRAVEL, abs=0.0003)


def test_hysteresis(engine: BulletClient, controller: Controller) -> None:
    between = (PRESS_DEPTH + RELEASE_DEPTH) / 2
    link = controller.links[list(KEY_PLACES).index(Keys.LEFT)]
    found = []
    for depth in (between, PRESS_DEPTH + 1e-4, between, RELEASE_DEPTH - 1e-4, between):
        engine.resetJointState(controller.body, link, depth)
        found.append(controller.pressed())
    assert found == [Keys.NONE, Keys.LEFT, Keys.LEFT, Keys.NONE, Keys.NONE]


def test_pressed_keys_change_colour_and_back(
    engine: BulletClient, controller: Controller
) -> None:
    link = controller.links[list(KEY_PLACES).index(Keys.FIRE)]

    def colour() -> tuple[float, ...]:
        controller.pressed()
        controller.show()
        shapes = engine.getVisualShapeData(controller.body)
        return next(tuple(shape[7]) for shape in shapes if shape[1] == link)

    released = colour()
    engine.resetJointState(controller.body, link, TRAVEL)
    assert colour() != released
    engine.resetJointState(controller.body, link, 0.0)
    assert colour() == released


@pytest.mark.parametrize("keys", [k for k in KEYS_OF_ACTION if k and k & DIRECTIONS == k])
def test_a_fingertip_has_room_on_exactly_its_keys(keys: Keys) -> None:
    """Distances to the keys' squares, computed in axes turned by 45°."""
    x, y = place_of(keys)
    for key, (key_x, key_y) in KEY_PLACES.items():
        along = abs((x - key_x) + (y - key_y)) / math.sqrt(2)
        across = abs((x - key_x) - (y - key_y)) / math.sqrt(2)
        gap = math.hypot(max(along - KEY_PITCH / 2, 0), max(across - KEY_PITCH / 2, 0))
        if key & keys:
            assert gap < 1e-9
        else:
            assert gap > FINGERTIP_RADIUS + 0.001
