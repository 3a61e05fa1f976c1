"""PyBullet, imported and opened without a word on the terminal."""

from typing import Any

from actors.robots.nao.silence import silenced

with silenced():
    # The import itself prints a build time.
    import pybullet
    from pybullet_utils.bullet_client import BulletClient


def open_engine() -> Any:
    """A physics engine of its own, without a display: PyBullet's functions as methods."""
    with silenced():
        return BulletClient(pybullet.DIRECT)
