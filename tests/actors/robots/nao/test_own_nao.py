"""A robot of the user's own in the pictures. Ours, written to a file, serves as the other one:
its pictures should then be the same."""

from pathlib import Path

import numpy as np
import pytest

from actors.robots.nao.assembly import write_nao
from actors.robots.nao.own_nao import OwnNao
from actors.robots.nao.robot import Nao
from common.actions import Keys
from common.errors import InputError
from common.protocol.live_view import ViewName
from common.settings.conditions import PERFECT_CAMERA, CameraConfig

GAME = np.random.default_rng(0).integers(0, 256, (210, 160, 3), np.uint8)
SIZE = (160, 120)


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    """Our robot's, with its mesh beside it."""
    return write_nao(tmp_path)


def hold(room: Nao, keys: Keys) -> None:
    room.command(keys)
    for _ in range(16):
        pressed = room.step_frame()
    assert pressed == keys


@pytest.mark.parametrize("viewpoint", ["room", "hands"])
def test_it_sits_and_moves_as_ours_does(room: Nao, urdf: Path, viewpoint: ViewName) -> None:
    room.rest()
    own = OwnNao(urdf, (210, 160))
    pictures = []
    for keys in (Keys.UP | Keys.FIRE, Keys.LEFT):
        hold(room, keys)
        found = own.view(room, GAME, *SIZE, viewpoint)
        ours = room.view(GAME, *SIZE, viewpoint)
        differing = (np.abs(found.astype(int) - ours).max(axis=2) > 8).mean()
        assert differing < 0.002
        pictures.append(found)
    assert (pictures[0] != pictures[1]).any()
    own.close()


def test_other_links_and_colours_and_a_base_below_the_torso(room: Nao, urdf: Path) -> None:
    """As in the URDF of NAO that is around: the file begins with a link that is not the torso."""
    text = urdf.read_text().replace('"torso"', '"Torso"').replace('"l_hand"', '"l_wrist"')
    base = (
        '<link name="base_link"/><joint name="base_joint" type="fixed"><parent link="base_link"/>'
        '<child link="Torso"/><origin xyz="0.3 -0.2 0.5" rpy="0 0 0.7"/></joint>'
    )
    text = text.replace('<robot name="nao">', f'<robot name="mine">{base}')
    same = urdf.with_name("same.urdf")
    same.write_text(text)
    painted = urdf.with_name("painted.urdf")
    start, *visuals = text.split('<color rgba="')
    painted.write_text(
        start + "".join(f'<color rgba="1 0 1 1{v[v.index(chr(34)) :]}' for v in visuals)
    )
    room.rest()
    ours = room.view(GAME, *SIZE)
    own = OwnNao(same, (210, 160))
    assert (np.abs(own.view(room, GAME, *SIZE, "room").astype(int) - ours) > 8).mean() < 0.002
    own.close()
    own = OwnNao(painted, (210, 160))
    found = own.view(room, GAME, *SIZE, "room").astype(int)
    own.close()
    magenta = (found[:, :, 0] - found[:, :, 1] > 80) & (found[:, :, 2] - found[:, :, 1] > 80)
    at_the_robot = np.zeros(magenta.shape, bool)
    at_the_robot[40:, :80] = True
    assert (magenta & at_the_robot).mean() > 0.02


def test_a_screen_that_was_pushed_is_shown_there(room: Nao, urdf: Path) -> None:
    own = OwnNao(urdf, (210, 160))
    room.set_eye(CameraConfig(screen_distance=1.15, screen_tilt=6.0))
    try:
        ours = room.view(GAME, *SIZE)
        found = own.view(room, GAME, *SIZE, "room")
        assert (np.abs(found.astype(int) - ours) > 8).mean() < 0.002
    finally:
        room.set_eye(PERFECT_CAMERA)
        own.close()


def test_missing_joints_are_listed(urdf: Path) -> None:
    text = urdf.read_text().replace("LElbowRoll", "left_elbow").replace("RElbowYaw", "other")
    urdf.write_text(text)
    with pytest.raises(InputError, match="no joints called LElbowRoll, RElbowYaw:"):
        OwnNao(urdf, (210, 160))


def test_joints_that_do_not_turn_are_missing(urdf: Path) -> None:
    text = urdf.read_text()
    urdf.write_text(
        text.replace('name="RElbowRoll" type="revolute"', 'name="RElbowRoll" type="fixed"')
    )
    with pytest.raises(InputError, match="no joints called RElbowRoll:"):
        OwnNao(urdf, (210, 160))


def test_a_mesh_that_is_gone_is_named(urdf: Path) -> None:
    urdf.with_name("ball.obj").unlink()
    with pytest.raises(InputError, match=r"shows the mesh ball\.obj, which is in no folder"):
        OwnNao(urdf, (210, 160))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "does not exist"),
        ("<robot", "cannot be loaded"),
        ('<robot name="r"><link name="torso"/></robot>', "shows nothing"),
    ],
)
def test_files_that_cannot_be_shown(
    tmp_path: Path, content: str | None, words: str, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "robot.urdf"
    if content is not None:
        path.write_text(content)
    with pytest.raises(InputError, match=words):
        OwnNao(path, (210, 160))
    assert capfd.readouterr() == ("", "")
