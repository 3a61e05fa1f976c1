"""The keys: springs, travel, threshold, hysteresis, and space for one fingertip."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actors.robots.nao.controller import (
    CENTRE,
    KEY_PITCH,
    KEY_PLACES,
    SPRING_FORCE,
    TRAVEL,
    Controller,
    place_of,
)
from actors.robots.nao.posture import FINGERTIP_RADIUS
from actors.robots.room.engine import open_engine
from common.actions import KEYS_OF_ACTION, Keys

DIRECTIONS = Keys.UP | Keys.DOWN | Keys.LEFT | Keys.RIGHT


@pytest.fixture
def engine() -> Iterator[Any]:
    engine = open_engine()
    engine.setGravity(0, 0, -9.81)
    engine.setPhysicsEngineParameter(fixedTimeStep=1 / 240)
    yield engine
    engine.disconnect()


@pytest.fixture
def controller(engine: Any, tmp_path: Path) -> Controller:
    return Controller(engine, tmp_path, 0.2)


def push(engine: Any, controller: Controller, key: Keys, newton: float) -> Keys:
    """Pushes one key down for half a second; returns the pressed keys."""
    link = controller.movables[list(KEY_PLACES).index(key)][0]
    for _ in range(120):
        engine.applyExternalForce(
            controller.body, link, (0, 0, -newton), (0, 0, 0), engine.LINK_FRAME
        )
        engine.stepSimulation()
    return controller.pressed()


@pytest.mark.parametrize("key", list(KEY_PLACES))
def test_a_key_needs_more_than_its_spring(engine: Any, controller: Controller, key: Keys) -> None:
    assert push(engine, controller, key, 0.7 * SPRING_FORCE) == Keys.NONE
    assert push(engine, controller, key, 1.5 * SPRING_FORCE) == key
    assert push(engine, controller, key, 0.0) == Keys.NONE
    assert controller.depths().max() < 0.0003


def test_a_key_stops_at_the_end_of_its_travel(engine: Any, controller: Controller) -> None:
    push(engine, controller, Keys.UP, 5.0)
    assert controller.depths()[0] == pytest.approx(TRAVEL, abs=0.0003)


@pytest.mark.parametrize("threshold", [1.0, 0.5, 1.4])
def test_hysteresis(engine: Any, controller: Controller, threshold: float) -> None:
    """A key is pressed 2.0 mm down, and released 1.2 mm down."""
    controller.set_threshold(threshold)
    press, release = threshold * 0.0020, threshold * 0.0012
    link = controller.movables[list(KEY_PLACES).index(Keys.LEFT)][0]
    found = []
    for depth in (press - 1e-5, press + 1e-5, release + 1e-5, release - 1e-5, press - 1e-5):
        engine.resetJointState(controller.body, link, depth)
        found.append(controller.pressed())
    assert found == [Keys.NONE, Keys.LEFT, Keys.LEFT, Keys.NONE, Keys.NONE]
    controller.set_threshold(1.0)


def test_pressed_keys_change_colour_and_back(engine: Any, controller: Controller) -> None:
    link = controller.movables[list(KEY_PLACES).index(Keys.FIRE)][0]

    def colour() -> list[int]:
        """Returns the colour of the button's centre from above."""
        controller.pressed()
        controller.show()
        x, y = KEY_PLACES[Keys.FIRE]
        above = (CENTRE[0] + x, CENTRE[1] + y, 0.3)
        view = engine.computeViewMatrix(above, (*above[:2], 0.2), (1, 0, 0))
        lens = engine.computeProjectionMatrixFOV(5, 1, 0.01, 1)
        _, _, rgba, _, _ = engine.getCameraImage(8, 8, view, lens)
        return list(np.asarray(rgba).reshape(8, 8, 4)[4, 4, :3])

    released = colour()
    assert released[0] > released[1]  # red
    engine.resetJointState(controller.body, link, TRAVEL)
    pressed = colour()
    assert pressed[1] > pressed[0]  # green
    engine.resetJointState(controller.body, link, 0.0)
    assert colour() == released


@pytest.mark.parametrize("keys", [k for k in KEYS_OF_ACTION if k and k & DIRECTIONS == k])
def test_a_fingertip_has_room_on_exactly_its_keys(keys: Keys) -> None:
    """Distances to the keys' squares are computed in axes turned by 45°."""
    x, y = place_of(keys)
    for key, (key_x, key_y) in KEY_PLACES.items():
        along = abs((x - key_x) + (y - key_y)) / math.sqrt(2)
        across = abs((x - key_x) - (y - key_y)) / math.sqrt(2)
        gap = math.hypot(max(along - KEY_PITCH / 2, 0), max(across - KEY_PITCH / 2, 0))
        if key & keys:
            assert gap < 1e-9
        else:
            assert gap > FINGERTIP_RADIUS + 0.001


def test_all_of_a_cap_is_within_its_radius(engine: Any, controller: Controller) -> None:
    """A disc's rim is √(r² + (h / 2)²) from its centre, a box's corner half the box's diagonal."""
    radii = dict(controller.movables)
    reaches = {}
    for _, link, kind, size, *_ in engine.getVisualShapeData(controller.body):
        if kind == engine.GEOM_CYLINDER:
            height, radius, _ = size
            reaches[link] = math.hypot(radius, height / 2)
        elif link in radii:
            reaches[link] = math.hypot(*size) / 2
    assert reaches.keys() == radii.keys()
    assert all(radii[link] >= reach - 1e-9 for link, reach in reaches.items())


@pytest.mark.parametrize("key", list(KEY_PLACES))
def test_the_stop_is_hard(engine: Any, controller: Controller, key: Keys) -> None:
    """A key that was pushed beyond its stop is back at it after the next reading."""
    index = list(KEY_PLACES).index(key)
    engine.resetJointState(controller.body, controller.movables[index][0], TRAVEL + 0.003, 1.0)
    assert controller.pressed() == key
    assert controller.depths()[index] == pytest.approx(TRAVEL)
    for _ in range(60):
        engine.stepSimulation()
    assert controller.pressed() == Keys.NONE
