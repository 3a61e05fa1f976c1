"""Parts, by the formulas of a textbook, and what the engine reads from the text."""

import math
from pathlib import Path

import numpy as np
import pytest

from actors.robots.room.engine import open_engine
from actors.robots.room.shapes import ALONG_X, Shape, ball, rod
from actors.robots.room.urdf import Joint, Part, weighed, write_urdf

GREY = (0.5, 0.5, 0.5)
BOX = Shape("box", (1.0, 2.0, 3.0), (0.0, 0.0, 0.0), GREY)


@pytest.mark.parametrize(
    ("shape", "diagonal"),
    [
        (BOX, (13.0, 10.0, 5.0)),  # m (b² + c²) / 12 …
        (rod(1.0, 6.0, (0.0, 0.0, 0.0), GREY), (39.0, 39.0, 6.0)),  # m (3 r² + l²) / 12, m r² / 2
        (rod(1.0, 6.0, (0.0, 0.0, 0.0), GREY, ALONG_X), (6.0, 39.0, 39.0)),
        (ball(5.0, (0.0, 0.0, 0.0), GREY), (120.0, 120.0, 120.0)),  # 2/5 m r²
        (Shape("egg", (1.0, 2.0, 3.0), (0.0, 0.0, 0.0), GREY), (31.2, 24.0, 12.0)),
    ],
)
def test_the_inertia_of_a_shape_of_12_kg(
    shape: Shape, diagonal: tuple[float, float, float]
) -> None:
    part = weighed("p", (shape, 12.0))
    assert part.mass == 12.0
    assert part.inertia == pytest.approx(np.diag(diagonal), abs=1e-5)


def test_two_balls_on_a_bar_turn_about_their_common_centre() -> None:
    part = weighed("p", *((ball(0.5, (x, 1.0, 0.0), GREY), 3.0) for x in (1.0, 5.0)))
    assert part.centre == pytest.approx([3.0, 1.0, 0.0])
    # Each 2/5 · 3 · 0.25 = 0.3, and 3 · 2² about the axes that the bar turns about.
    assert part.inertia == pytest.approx(np.diag([0.6, 24.6, 24.6]))
    assert part.extent == pytest.approx(2.5)


def test_a_boxs_farthest_corner_counts() -> None:
    assert Part("p", shapes=[BOX]).extent == pytest.approx(math.sqrt(14) / 2)
    upright = Shape("box", (0.2, 0.2, 2.0), (0.0, 3.0, 0.0), GREY)
    assert Part("p", shapes=[upright]).extent == pytest.approx(math.sqrt(0.01 + 3.1**2 + 1))
    lying = Shape("box", (0.2, 0.2, 2.0), (0.0, 3.0, 0.0), GREY, (math.pi / 2, 0.0, 0.0))
    assert Part("p", shapes=[lying]).extent == pytest.approx(math.sqrt(0.01 + 4.0**2 + 0.01))


def test_the_engine_reads_parts_joints_and_what_touches(tmp_path: Path) -> None:
    foot = weighed("foot", (BOX, 1.0))
    lid = weighed(
        "lid",
        (Shape("box", (1.0, 1.0, 0.1), (0.2, 0.0, 0.0), GREY, solid=True), 2.0),
        (ball(0.1, (0.0, 0.0, 1.0), GREY, solid=True), 1.0),
        (rod(0.1, 0.1, (0.0, 0.0, 2.0), GREY), 1.0),
    )
    joint = Joint(
        "up", "foot", "lid", (0.0, 0.0, 2.0), (0.0, 0.0, 1.0), -0.5, 0.25, 3.0, 4.0, "prismatic"
    )
    path = write_urdf(tmp_path, "b", [foot, lid], [joint])
    engine = open_engine()
    body = engine.loadURDF(str(path), useFixedBase=True, flags=engine.URDF_USE_INERTIA_FROM_FILE)
    infos = {
        engine.getJointInfo(body, index)[1].decode(): engine.getJointInfo(body, index)
        for index in range(engine.getNumJoints(body))
    }
    assert set(infos) == {"up", "lid_touch", "lid_touch1"}
    assert infos["up"][2] == engine.JOINT_PRISMATIC
    assert infos["up"][8:12] == (-0.5, 0.25, 4.0, 3.0)
    solid = {
        name: [data[2] for data in engine.getCollisionShapeData(body, info[0])]
        for name, info in infos.items()
    }
    assert solid == {"up": [], "lid_touch": [engine.GEOM_BOX], "lid_touch1": [engine.GEOM_SPHERE]}
    assert engine.getDynamicsInfo(body, infos["up"][0])[0] == pytest.approx(4.0)
    engine.disconnect()
