"""What is recorded for Rerun, read back, and what is refused."""

import sys
from contextlib import closing
from dataclasses import replace
from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from actors.envs import make_env
from actors.envs.robot import RobotEnv
from actors.loop import play
from actors.robots.room.engine import joints_of
from actors.robots.room.furniture import PICTURE_CORNERS
from actors.vision.layout import BORDER
from common.actions import Keys
from common.command_line.played import playing_settings
from common.errors import InputError
from common.registry import ENVIRONMENTS, ROBOTS
from common.run.origin import find_weights
from tests.extending.test_environment import CONFIG as LAMPS_CONFIG
from tests.extending.test_environment import LAMPS
from tests.extending.test_robot import FINGER
from tests.extending.test_robot import config as finger_config
from tests.extending.whole_run import added
from tests.viewer.rrd import at, recorded
from viewer.player import ShownPolicy, shown_env
from viewer.rerun_stream import RerunStream

STEPS = 54
"""Agent steps: 3.6 s of play."""


@pytest.fixture
def emulator() -> Any:
    """The cheapest environment."""
    with closing(make_env(playing_settings(None, "ale"), training=False)) as env:
        yield env


@pytest.fixture(scope="module")
def game(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """A recording of a game with the published robot's values, and what engine and game said."""
    pytest.importorskip("rerun", reason="needs pip install 'ale-robot[viz]'")
    path = tmp_path_factory.mktemp("rerun") / "new" / "game.rrd"
    weights = find_weights("robot_pong")
    config = playing_settings(weights)
    policy = ShownPolicy.of_file(config, weights, 0.999, 3)  # soon a point is lost
    truth = []
    with closing(make_env(config, training=False)) as env:
        assert isinstance(env, RobotEnv)
        room: Any = env.robot
        engine, body = room._engine, room.arms.body
        links = joints_of(engine, body)
        with closing(RerunStream(env, live=False, save=path)) as stream:
            for step in islice(play([env], policy, [1]), STEPS):
                stream.show(step, policy.values)
                states = {
                    name: engine.getLinkState(body, link, computeForwardKinematics=1)
                    for name, link in links.items()
                }
                said = SimpleNamespace(
                    positions={name: state[4] for name, state in states.items()},
                    turns={name: state[5] for name, state in states.items()},
                    angles={
                        name: engine.getJointState(body, link)[0] for name, link in links.items()
                    },
                    wanted=env.wanted,
                    pressed=env.pressed,
                    seen=env.seen,
                    screen=env.emulator.screen_rgb(),
                    corners=env.detection.corners,
                    step=step,
                    values=policy.values,
                )
                truth.append(said)
        children = {
            name: engine.getJointInfo(body, link)[12].decode() for name, link in links.items()
        }
    return SimpleNamespace(said=truth, found=recorded(path), children=children)


def test_links_are_where_the_engine_has_them(game: SimpleNamespace) -> None:
    moved = set()
    for number, said in enumerate(game.said, 1):
        for joint, link in game.children.items():
            found = game.found[f"/robot/{link}"]
            place = at(found["Transform3D:translation"], number)[0]
            turn = at(found["Transform3D:quaternion"], number)[0]
            assert place == pytest.approx(said.positions[joint], abs=1e-5)
            assert abs(np.dot(turn, said.turns[joint])) == pytest.approx(1.0, abs=1e-5)
            if np.linalg.norm(np.subtract(place, game.said[0].positions[joint])) > 0.001:
                moved.add(link)
    assert {"l_elbow", "l_forearm"} <= moved


def test_only_what_moves_is_sent_again(game: SimpleNamespace) -> None:
    for still in ("/robot/torso", "/room/desk", "/room/screen", "/robot/camera"):
        assert list(game.found[still]["Transform3D:translation"]) == [1]
    shapes = [
        (entity, name)
        for entity, components in game.found.items()
        for name in components
        if name.split(":")[0] in ("Boxes3D", "Cylinders3D", "Ellipsoids3D")
    ]
    assert len({entity for entity, _ in shapes}) > 20
    assert all(list(game.found[entity][name]) == [-1] for entity, name in shapes)


def test_figures_are_those_of_the_game(game: SimpleNamespace) -> None:
    found, scalars = game.found, "Scalars:scalars"
    for number, said in enumerate(game.said, 1):
        assert found["/play/score"][scalars][number] == [said.step.info.game_score]
        assert found["/play/steps"][scalars][number] == [said.step.info.game_steps]
        for action, name in enumerate(("noop", "fire", "right", "left", "right_fire", "left_fire")):
            assert found[f"/q/{name}"][scalars][number] == [float(said.values[action])]
        for kind, keys in (("commanded", said.wanted), ("pressed", said.pressed)):
            every = (Keys.UP, Keys.DOWN, Keys.LEFT, Keys.RIGHT, Keys.FIRE)
            assert found[f"/keys/{kind}"][scalars][number] == [float(k in keys) for k in every]
        for joint in ("LShoulderPitch", "RElbowRoll"):
            assert found[f"/joints/{joint}"][scalars][number] == [said.angles[joint]]
        assert found["game time"]["seconds"][number] == pytest.approx(number / 15, abs=1e-8)
    assert found["/joints/LShoulderPitch"]["SeriesLines:names"] == {-1: ["LShoulderPitch, rad"]}
    assert len({said.step.info.game_score for said in game.said}) > 1
    assert len({said.pressed for said in game.said}) > 1


def picture(rows: dict[int, Any], number: int) -> np.ndarray:
    data = np.frombuffer(bytes(rows[number][0]), np.uint8)
    assert len(data) < 60_000
    read = cv2.imdecode(data, cv2.IMREAD_COLOR)
    assert read is not None
    return cv2.cvtColor(read, cv2.COLOR_BGR2RGB)


def test_pictures_are_those_that_were_seen(game: SimpleNamespace) -> None:
    found, blob = game.found, "EncodedImage:blob"
    for number in (1, STEPS):
        said = game.said[number - 1]
        for entity, shown in (
            ("/robot/camera", said.seen),
            ("/network/input", np.repeat(said.step.s_t[-1][:, :, None], 3, axis=2)),
        ):
            difference = picture(found[entity][blob], number) - shown.astype(float)
            assert np.abs(difference).mean() < 4
        projected = picture(found["/room/screen/game"][blob], number)
        rows, columns = projected.shape[:2]
        assert projected[: int(0.06 * rows)].max() < 20  # the border is black
        across, down = (BORDER * edge / (1 + 2 * BORDER) for edge in (columns, rows))
        inside = projected[
            round(down) : rows - round(down), round(across) : columns - round(across)
        ]
        small = [
            cv2.resize(p, (16, 12), interpolation=cv2.INTER_AREA) for p in (inside, said.screen)
        ]
        assert np.abs(np.subtract(*small, dtype=float)).mean() < 4
        outline = found["/robot/camera/detection"]["LineStrips2D:strips"][number]
        assert outline[1][:4] == pytest.approx(said.corners + 0.5, abs=1e-3)


def corners_of_picture(found: dict[str, Any]) -> np.ndarray:
    """Where a picture's corners are drawn, by its pinhole, in the frame of its transform."""
    (matrix,) = found["Pinhole:image_from_camera"].values()
    (size,) = found["Pinhole:resolution"].values()
    (distance,) = found["Pinhole:image_plane_distance"].values()
    intrinsic = np.reshape(matrix[0], (3, 3)).T
    width, height = size[0]
    pixels = np.array([[0, 0, 1], [width, 0, 1], [width, height, 1], [0, height, 1]])
    rays = pixels @ np.linalg.inv(intrinsic).T * distance[0]
    (place,) = found["Transform3D:translation"].values()
    (turn,) = found["Transform3D:mat3x3"].values()
    corners: np.ndarray = rays @ np.reshape(turn[0], (3, 3)) + place[0]
    return corners


def test_the_game_is_on_the_screen(game: SimpleNamespace) -> None:
    corners = corners_of_picture(game.found["/room/screen/game"])
    assert corners == pytest.approx(PICTURE_CORNERS - (0.001, 0.0, 0.0), abs=1e-5)


def test_the_camera_looks_at_the_screen(game: SimpleNamespace) -> None:
    """The ray of a corner that the detector found meets the projected picture's corner."""
    found = game.found["/robot/camera"]
    corners = corners_of_picture(found)
    (eye,) = found["Transform3D:translation"].values()
    said = game.said[0]
    share = (said.corners.mean(axis=0) + 0.5) / (320, 240)
    across, down = corners[1] - corners[0], corners[3] - corners[0]
    ray = corners[0] + share[0] * across + share[1] * down - eye[0]
    hit = eye[0] + ray * (PICTURE_CORNERS[0, 0] - eye[0][0]) / ray[0]
    assert hit == pytest.approx(PICTURE_CORNERS.mean(axis=0), abs=0.01)


def test_a_robot_without_a_room_has_pictures_and_figures(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="needs pip install 'ale-robot[viz]'")
    config = finger_config()
    config = replace(config, play=replace(config.play, vector=False))
    with added(ROBOTS, FINGER), closing(make_env(config, training=False)) as env:
        policy = ShownPolicy.of_file(config, None, 1.0, 0)
        stream = RerunStream(env, live=False, save=tmp_path / "finger.rrd")
        with closing(stream):
            for step in islice(play([env], policy, [1]), 3):
                stream.show(step, policy.values)
    found = recorded(tmp_path / "finger.rrd")
    for entity in ("/game", "/robot/camera", "/network/input"):
        assert list(found[entity]["EncodedImage:blob"]) == [1, 2, 3]
    assert list(found["/keys/pressed"]["Scalars:scalars"]) == [1, 2, 3]
    assert not any("3D" in component for entity in found.values() for component in entity)


def test_an_emulator_alone_has_no_keys(tmp_path: Path, emulator: Any) -> None:
    pytest.importorskip("rerun", reason="needs pip install 'ale-robot[viz]'")
    config = playing_settings(None, "ale")
    policy = ShownPolicy.of_file(config, None, 1.0, 0)
    stream = RerunStream(emulator, live=False, save=tmp_path / "a.rrd")
    with closing(stream):
        stream.show(next(play([emulator], policy, [1])), policy.values)
    found = recorded(tmp_path / "a.rrd")
    assert list(found["/game"]["EncodedImage:blob"]) == [1]
    assert "Scalars:scalars" not in found["/keys/pressed"]


def test_an_environment_from_outside_has_its_picture_and_numbers_of_actions(
    tmp_path: Path,
) -> None:
    pytest.importorskip("rerun", reason="needs pip install 'ale-robot[viz]'")
    values = np.array([0.5, 1.0, 0.25], np.float32)
    with added(ENVIRONMENTS, LAMPS), shown_env(LAMPS_CONFIG) as env:
        policy = ShownPolicy.of_file(LAMPS_CONFIG, None, 1.0, 0)
        with closing(RerunStream(env, live=False, save=tmp_path / "l.rrd")) as stream:
            for step in islice(play([env], policy, [1]), 3):
                stream.show(step, values)
        seen = env.seen
    found = recorded(tmp_path / "l.rrd")
    assert [found[f"/q/{action}"]["Scalars:scalars"][3] for action in range(3)] == [
        [0.5], [1.0], [0.25]
    ]  # fmt: skip
    shown = picture(found["/game"]["EncodedImage:blob"], 3)
    sizes = [cv2.resize(each, (16, 12), interpolation=cv2.INTER_AREA) for each in (shown, seen)]
    assert np.abs(np.subtract(*sizes, dtype=float)).mean() < 8
    assert found["game time"]["seconds"][3] == pytest.approx(3 / 5, abs=1e-8)  # by its metadata


@pytest.mark.parametrize(("name", "said"), [("a.txt", "end in .rrd"), ("file/a.rrd", "cannot be")])
def test_a_file_that_cannot_be(tmp_path: Path, emulator: Any, name: str, said: str) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=said):
        RerunStream(emulator, live=False, save=tmp_path / name)


@pytest.mark.parametrize("missing", ["rerun", "psutil_of_rerun"])
def test_the_package_that_is_missing_is_named(
    tmp_path: Path, emulator: Any, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    (tmp_path / "rerun.py").write_text(f"import {missing}")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "rerun", raising=False)
    if missing == "rerun":
        monkeypatch.setitem(sys.modules, "rerun", None)
    said = rf"needs the package {missing}, .*: pip install 'ale-robot\[viz\]'"
    with pytest.raises(InputError, match=said):
        RerunStream(emulator, live=True, save=None)
