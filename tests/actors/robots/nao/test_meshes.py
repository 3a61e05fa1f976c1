"""Meshes that are missing or broken are named before the engine gets them."""

import struct
from pathlib import Path

import pytest

from actors.robots.nao.meshes import check_meshes
from common.errors import InputError

OBJ = b"# a triangle\nv 0 0 0\nv 1 0 0 0.5 0.5 0.5\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 -1//1\n"
TRIANGLE = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0)
STL = b"made of numbers".ljust(80) + struct.pack("<I", 2) + 2 * TRIANGLE
STL_TEXT = (
    b"solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    b"endloop\nendfacet\nendsolid s\n"
)
DAE = (
    b'<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"><library_geometries><mesh>'
    b"<float_array>0 0 0 1 0 0 0 1 0</float_array><triangles><p>0 1 2</p></triangles>"
    b"</mesh></library_geometries></COLLADA>"
)


def urdf_with(folder: Path, mesh: str) -> Path:
    path = folder / "robot.urdf"
    path.write_text(
        '<robot name="r"><link name="torso"><visual><geometry><box size="1 1 1"/></geometry>'
        f'</visual><visual><geometry><mesh filename="{mesh}"/></geometry></visual>'
        '<collision><geometry><mesh filename="only/touched.obj"/></geometry></collision>'
        "</link></robot>"
    )
    return path


@pytest.mark.parametrize(
    ("name", "content"),
    [("m.obj", OBJ), ("m.STL", STL), ("m.stl", STL_TEXT), ("m.dae", DAE)],
    ids=["obj", "stl", "stl-text", "dae"],
)
def test_whole_meshes_pass_and_torn_ones_do_not(tmp_path: Path, name: str, content: bytes) -> None:
    urdf = urdf_with(tmp_path, name)
    mesh = tmp_path / name
    mesh.write_bytes(content)
    check_meshes(urdf)
    for torn in (b"", b"\xff\x00nonsense", content[:-10], content[: len(content) // 3]):
        mesh.write_bytes(torn)
        with pytest.raises(InputError, match=f"mesh .*{name} of .*robot.urdf is broken"):
            check_meshes(urdf)


@pytest.mark.parametrize(
    "content",
    [
        OBJ.replace(b"-1//1", b"4//1"),
        OBJ.replace(b"-1//1", b""),
        OBJ.replace(b"1//1", b"0//1"),
        OBJ.replace(b"v 1 0 0", b"v one 0 0"),
        OBJ.replace(b"f ", b"l "),
    ],
)
def test_an_obj_with_faces_between_points_that_are_not_there(
    tmp_path: Path, content: bytes
) -> None:
    urdf = urdf_with(tmp_path, "m.obj")
    (tmp_path / "m.obj").write_bytes(content)
    with pytest.raises(InputError, match="broken"):
        check_meshes(urdf)


@pytest.mark.parametrize("place", ["nao/urdf", "nao", "."])
def test_a_package_may_be_any_folder_above(tmp_path: Path, place: str) -> None:
    folder = tmp_path / "nao" / "urdf"
    folder.mkdir(parents=True)
    urdf = urdf_with(folder, "package://nao_meshes/head.obj")
    with pytest.raises(InputError, match=r"package://nao_meshes/head\.obj, which is in no folder"):
        check_meshes(urdf)
    (tmp_path / place / "nao_meshes").mkdir()
    (tmp_path / place / "nao_meshes" / "head.obj").write_bytes(OBJ)
    check_meshes(urdf)


def test_kinds_that_cannot_be_shown(tmp_path: Path) -> None:
    (tmp_path / "m.ply").write_bytes(b"ply")
    with pytest.raises(InputError, match=r"m\.ply: only \.obj, \.stl, \.dae"):
        check_meshes(urdf_with(tmp_path, "m.ply"))
