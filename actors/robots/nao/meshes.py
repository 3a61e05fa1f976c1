"""Checks that the meshes of a URDF exist and are whole, because the engine does not.

The engine (3.2.7) takes what is left of a broken OBJ for the whole and shows nothing, and a broken
COLLADA file ends the process. So every mesh is checked before the engine gets it.
"""

import struct
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

from common.errors import InputError

_SCHEMES = ("package://", "model://", "file://")


def check_meshes(urdf: Path) -> None:
    """Checks all meshes of the visible parts.

    Raises:
        InputError: the file is not a URDF, or a mesh is not found, is of a kind that the engine
            does not read, or is broken.
    """
    try:
        robot = ElementTree.parse(urdf).getroot()
    except (ElementTree.ParseError, UnicodeDecodeError) as error:
        raise InputError(f"{urdf} cannot be loaded: it is not a URDF file ({error}).") from None
    except OSError as error:
        raise InputError(f"{urdf} cannot be loaded: {error.strerror}.") from None
    names = [mesh.get("filename", "") for mesh in robot.iterfind("link/visual/geometry/mesh")]
    for name in dict.fromkeys(names):
        mesh = _find(name, urdf)
        if mesh is None:
            raise InputError(
                f"{urdf} shows the mesh {name}, which is in no folder above it: put it there, "
                "or write its name relative to the URDF file."
            )
        whole = _WHOLE.get(mesh.suffix.lower())
        if whole is None:
            raise InputError(
                f"{urdf} shows the mesh {mesh}: only {', '.join(_WHOLE)} can be shown."
            )
        try:
            broken = not whole(mesh.read_bytes())
        except OSError as error:
            raise InputError(f"the mesh {mesh} cannot be read: {error.strerror}.") from None
        except (ValueError, ElementTree.ParseError):
            broken = True
        if broken:
            raise InputError(f"the mesh {mesh} of {urdf} is broken: fetch or export it again.")


def _find(name: str, urdf: Path) -> Path | None:
    """Returns where the engine finds a mesh: relative to the URDF's folder or one above it."""
    for scheme in _SCHEMES:
        name = name.removeprefix(scheme)
    places = (folder / name for folder in urdf.resolve().parents)
    return next((place for place in places if place.is_file()), None)


def _whole_obj(content: bytes) -> bool:
    """Whether there are points, and only faces between points that exist."""
    points = faces = 0
    for line in content.splitlines():
        kind, *numbers = line.split() or [b""]
        if kind == b"v":
            points += len([float(number) for number in numbers]) >= 3
        elif kind == b"f":
            corners = [int(number.split(b"/")[0]) for number in numbers]
            # Negative numbers count back from the last point.
            if len(corners) < 3 or not all(0 < abs(corner) <= points for corner in corners):
                return False
            faces += 1
    return faces > 0


def _whole_stl(content: bytes) -> bool:
    """Whether it is binary with as many triangles as it says, or text with some."""
    if len(content) >= 84:
        (triangles,) = struct.unpack_from("<I", content, 80)
        if len(content) == 84 + 50 * triangles:
            return bool(triangles)
    text = content.lstrip()
    return text.startswith(b"solid") and b"vertex" in text and b"endsolid" in text


def _whole_collada(content: bytes) -> bool:
    """Whether it is complete XML with numbers and faces."""
    root = ElementTree.fromstring(content)
    found = {element.tag.rpartition("}")[2] for element in root.iter()}
    faces = {"triangles", "polylist", "polygons"}
    return root.tag.endswith("COLLADA") and "float_array" in found and bool(found & faces)


_WHOLE: dict[str, Callable[[bytes], bool]] = {
    ".obj": _whole_obj,
    ".stl": _whole_stl,
    ".dae": _whole_collada,
}
