"""Which of Rerun's viewers shows the stream."""

import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.request import urlopen

import pytest

from common.errors import InputError
from viewer import rerun_viewer
from viewer.rerun_viewer import RerunViewer

PROGRAM = f"""#!{sys.executable}
import sys, time
from http.server import HTTPServer, SimpleHTTPRequestHandler
from pathlib import Path
import threading
words = sys.argv[1:]
Path(__file__).with_name("words").write_text(" ".join(words))
said = dict(zip(words[1::2], words[2::2]))
for port in (said["--port"], said["--web-viewer-port"]):
    server = HTTPServer((said["--bind"], int(port)), SimpleHTTPRequestHandler)
    threading.Thread(target=server.serve_forever).start()
"""
"""Stands in for Rerun's program: serves something at both ports."""


class Rerun(ModuleType):
    """Takes down what it is told, in the place of the package."""

    def __init__(self) -> None:
        super().__init__("rerun")
        self.spawned: list[Any] = []
        self.spawn = lambda **said: self.spawned.append(said)


@pytest.fixture
def rerun() -> Rerun:
    return Rerun()


@pytest.fixture
def place(monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """Where a viewer could listen; nobody does yet."""
    with socket.socket() as place:
        place.bind(("127.0.0.1", 0))
        monkeypatch.setattr(rerun_viewer, "_PORT", place.getsockname()[1])
        yield place


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Beside this Python, whose folder need not be on the path; there is no display."""
    path = tmp_path / "rerun"
    path.write_text(PROGRAM)
    path.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    return path


@pytest.mark.usefixtures("program")
def test_the_viewer_that_runs_is_taken(rerun: Rerun, place: socket.socket) -> None:
    place.listen()
    with closing(RerunViewer(rerun)) as viewer:
        assert viewer.page is None
        viewer.linger(threading.Event())
    assert rerun.spawned == []


@pytest.mark.usefixtures("place")
def test_a_window_opens_on_a_display(
    rerun: Rerun, program: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    with closing(RerunViewer(rerun)) as viewer:
        assert viewer.page is None
    assert rerun.spawned == [{"executable_path": str(program), "connect": False}]


def test_without_a_display_a_page_is_served(
    rerun: Rerun, place: socket.socket, program: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    port = place.getsockname()[1]
    place.close()
    viewer = RerunViewer(rerun)
    with closing(viewer):
        assert viewer.page is not None
        assert viewer.page in capsys.readouterr().out
        assert viewer.page.endswith(f"?url=rerun%2Bhttp://127.0.0.1:{port}/proxy")
        assert urlopen(viewer.page.split("?")[0]).status == 200
        words = program.with_name("words").read_text()
        assert words.startswith(f"--serve-web --bind 127.0.0.1 --port {port} --web-viewer-port")
        stop = threading.Event()
        lingering = threading.Thread(target=viewer.linger, args=(stop,))
        lingering.start()
        stop.set()
        lingering.join()
    with pytest.raises(OSError, match="refused"):
        urlopen(viewer.page.split("?")[0])
    viewer.close()


@pytest.mark.usefixtures("place")
def test_a_server_that_does_not_start_is_told(rerun: Rerun, program: Path) -> None:
    program.write_text("#!/bin/sh\nexit 1\n")
    with pytest.raises(InputError, match=r"did not start: see what `.*rerun --serve-web` says"):
        RerunViewer(rerun)


@pytest.mark.usefixtures("place")
def test_a_program_that_is_missing_is_told(
    rerun: Rerun, program: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program.unlink()
    monkeypatch.setenv("PATH", "")
    with pytest.raises(InputError, match="pip install rerun-sdk again"):
        RerunViewer(rerun)
