"""Entry points of packages that look installed, for programs that are started from a folder."""

from pathlib import Path


def add_entry_point(folder: Path, package: str, noun: str, name: str, place: str) -> None:
    """Writes into ``folder``, as the metadata of a ``package``, an entry point ``name``: an
    environment, robot or algorithm (the ``noun``) at ``place``, such as ``module:ENTRY``."""
    metadata = folder / f"{package.replace('-', '_')}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Name: {package}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[ale_robot.{noun}s]\n{name} = {place}\n")
