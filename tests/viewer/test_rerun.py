"""What is streamed to Rerun, and what is said where its viewer cannot be had."""

import socket
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from common.errors import InputError
from viewer import rerun_stream
from viewer.rerun_stream import RerunStream

PANELS = np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8)


class Image:
    def __init__(self, pixels: np.ndarray) -> None:
        self.pixels = pixels

    def compress(self, *, jpeg_quality: int) -> tuple[str, bytes]:
        assert 50 <= jpeg_quality <= 100
        return "jpeg", self.pixels.tobytes()


class Rerun(ModuleType):
    """Takes down what it is told, in the place of the package."""

    def __init__(self) -> None:
        super().__init__("rerun")
        self.said: list[Any] = []
        self.Image = Image
        self.Scalars = float
        self.init = lambda name: self.said.append(("init", name))
        self.connect_grpc = lambda: self.said.append("connect")
        self.spawn = lambda *, executable_path: self.said.append(("spawn", executable_path))
        self.set_time = lambda line, *, sequence: self.said.append((line, sequence))
        self.log = lambda path, value: self.said.append((path, value))


@pytest.fixture
def rerun(monkeypatch: pytest.MonkeyPatch) -> Rerun:
    module = Rerun()
    monkeypatch.setitem(sys.modules, "rerun", module)
    return module


@pytest.fixture
def viewer(monkeypatch: pytest.MonkeyPatch) -> socket.socket:
    """Where one could listen; nobody does yet."""
    place = socket.socket()
    place.bind(("127.0.0.1", 0))
    monkeypatch.setattr(rerun_stream, "_VIEWER", place.getsockname())
    yield place
    place.close()


def test_every_picture_is_sent_to_the_viewer_that_runs(rerun: Rerun, viewer: socket.socket) -> None:
    viewer.listen()
    stream = RerunStream()
    stream.show(PANELS, -1.0, None)
    stream.show(PANELS, 2.0, np.array([0.5, 0.75], np.float32))
    picture = ("panels", ("jpeg", PANELS.tobytes()))
    assert rerun.said == [
        ("init", "ale-robot"),
        "connect",
        *(("agent step", 0), picture, ("score", -1.0)),
        *(("agent step", 1), picture, ("score", 2.0), ("max_q", 0.75)),
    ]


@pytest.mark.usefixtures("viewer")
def test_a_viewer_is_started_where_none_runs(
    rerun: Rerun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The one beside this Python, whose folder need not be on the path."""
    program = tmp_path / "rerun"
    program.write_text("")
    program.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    monkeypatch.setenv("DISPLAY", ":0")
    RerunStream()
    assert rerun.said[1:] == [("spawn", str(program))]


@pytest.mark.usefixtures("viewer", "rerun")
def test_without_a_display_another_way_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(InputError, match="rerun --serve-web"):
        RerunStream()


@pytest.mark.usefixtures("viewer")
def test_the_real_package_takes_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rerun = pytest.importorskip("rerun")
    path = tmp_path / "stream.rrd"
    monkeypatch.setattr(rerun_stream, "_viewer_runs", lambda: True)
    monkeypatch.setattr(rerun, "connect_grpc", lambda: rerun.save(path))
    stream = RerunStream()
    stream.show(PANELS, 1.0, np.array([0.5, 0.75], np.float32))
    rerun.disconnect()
    said = path.read_bytes()
    for entity in (b"/panels", b"/score", b"/max_q"):
        assert entity in said


@pytest.mark.parametrize(
    ("missing", "package"), [("rerun", "rerun-sdk"), ("psutil_of_rerun", "psutil_of_rerun")]
)
def test_the_package_that_is_missing_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: str, package: str
) -> None:
    (tmp_path / "rerun.py").write_text(f"import {missing}")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "rerun", raising=False)
    if missing == "rerun":
        monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(InputError, match=f"needs the package {package}, .*: pip install {package}"):
        RerunStream()
