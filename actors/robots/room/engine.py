"""Imports and opens PyBullet without output on the terminal; what all bodies in it have."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from actors.robots.room.silence import silenced

with silenced():
    # The import prints a build time.
    import pybullet
    from pybullet_utils.bullet_client import BulletClient


def open_engine() -> Any:
    """Returns a new physics client without a display; PyBullet's functions are its methods."""
    with silenced():
        return BulletClient(pybullet.DIRECT)


def joints_of(engine: Any, body: int) -> dict[str, int]:
    """Returns the numbers of a body's joints, which are those of their child links too, by name."""
    infos = (engine.getJointInfo(body, joint) for joint in range(engine.getNumJoints(body)))
    return {info[1].decode(): info[0] for info in infos}


def fixed_body(
    engine: Any, file: Path, content: str, position: Sequence[float]
) -> tuple[int, dict[str, int]]:
    """Returns a body that stands fixed at ``position``, m, and the numbers of its joints by name.

    Args:
        file: where the engine reads it; it is written.
        content: its URDF, whose inertias are used as they are.
    """
    file.write_text(content)
    body: int = engine.loadURDF(
        str(file), position, useFixedBase=True, flags=engine.URDF_USE_INERTIA_FROM_FILE
    )
    return body, joints_of(engine, body)
