"""Imports and opens PyBullet without output on the terminal."""

from typing import Any

from actors.robots.nao.silence import silenced

with silenced():
    # The import prints a build time.
    import pybullet
    from pybullet_utils.bullet_client import BulletClient


def open_engine() -> Any:
    """Returns a new physics client without a display; PyBullet's functions are its methods."""
    with silenced():
        return BulletClient(pybullet.DIRECT)
