"""An installed package, as far as its entry points go."""

from pathlib import Path


def install(folder: Path, package: str, noun: str, name: str, place: str) -> None:
    """Write into ``folder`` what makes an entry point ``name`` of a ``package``: an environment,
    robot or algorithm (the ``noun``) at ``place``, such as ``module:ENTRY``."""
    metadata = folder / f"{package.replace('-', '_')}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Name: {package}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[ale_robot.{noun}s]\n{name} = {place}\n")
