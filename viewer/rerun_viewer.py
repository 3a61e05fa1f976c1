"""The Rerun viewer: one that runs already, a new window, or a page for a browser."""

import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import ModuleType

from common.errors import InputError

_HOST, _PORT = "127.0.0.1", 9876
"""Address at which a viewer listens."""
_LEASHED = 'exec 3<&0; (read -r _ <&3; kill 0) & exec "$@" 3<&- </dev/null'
"""Shell command that runs a program whose whole process group ends when its standard input closes,
and so with this process, however that ends. Rerun's program starts another one, which would stay.
"""
_PATIENCE = 30.0
"""Seconds that a server may take from its start until it listens."""


class RerunViewer:
    """Uses a running viewer, or opens a window; without a display it serves a page on loopback.
    Raises InputError if the page's server cannot be started."""

    def __init__(self, rerun: ModuleType) -> None:
        self._server: subprocess.Popen[bytes] | None = None
        self.page: str | None = None
        """Address of the page, if this process serves one."""
        if _listens(_PORT):
            return
        # Also beside this Python, whose folder is on the path only in an activated environment.
        places = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
        program = shutil.which("rerun", path=places)
        if program is None:
            raise InputError(
                "--viewer rerun finds no program called rerun: pip install rerun-sdk again."
            )
        if any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY"))):
            rerun.spawn(executable_path=program, connect=False)
        else:
            self._serve(program)

    def _serve(self, program: str) -> None:
        with socket.socket() as free:
            free.bind((_HOST, 0))
            web_port = free.getsockname()[1]
        # Rerun's own Python functions would serve the page to the whole network.
        self._server = subprocess.Popen(
            [
                *("sh", "-c", _LEASHED, "sh"),
                *(program, "--serve-web", "--bind", _HOST),
                *("--port", str(_PORT), "--web-viewer-port", str(web_port)),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        patience = time.monotonic() + _PATIENCE
        while not (_listens(_PORT) and _listens(web_port)):
            if self._server.poll() is not None or time.monotonic() > patience:
                self.close()
                raise InputError(
                    f"the web viewer did not start: see what `{program} --serve-web` says."
                )
            time.sleep(0.1)
        at = f"rerun%2Bhttp://{_HOST}:{_PORT}/proxy"
        self.page = f"http://{_HOST}:{web_port}/?url={at}"
        print(f"open this page in a browser: {self.page}", flush=True)

    def linger(self, stop: threading.Event) -> None:
        """Keeps serving the page, if this process serves one, until ``stop`` is set."""
        if self._server is not None and not stop.is_set():
            print("the page stays until Ctrl-C", flush=True)
            while self._server.poll() is None and not stop.wait(1.0):
                pass

    def close(self) -> None:
        """Ends the page's server; a window stays open."""
        if self._server is not None:
            assert self._server.stdin is not None
            self._server.stdin.close()
            self._server.wait()


def _listens(port: int) -> bool:
    try:
        socket.create_connection((_HOST, port), 1.0).close()
    except OSError:
        return False
    return True
