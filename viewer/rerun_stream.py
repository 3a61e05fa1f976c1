"""Pictures and figures streamed live to the Rerun viewer, where the extra `viz` is installed."""

import os
import shutil
import socket
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from common.errors import InputError

_VIEWER = ("127.0.0.1", 9876)
"""Where a viewer listens."""
_QUALITY = 90
"""Of the JPEGs: an hour of bare pictures would not fit into the viewer's memory."""


class RerunStream:
    """Starts a viewer, or finds the one that runs, and sends it every picture.

    Raises:
        InputError: Rerun is not installed, or its viewer cannot be started here.
    """

    def __init__(self) -> None:
        self._rerun = _import_rerun()
        self._rerun.init("ale-robot")
        if _viewer_runs():
            self._rerun.connect_grpc()
        else:
            _start_viewer(self._rerun)
        self._agent_step = 0

    def show(
        self, panels: NDArray[np.uint8], score: float, values: NDArray[np.float32] | None
    ) -> None:
        """Send the panels, and score and greatest Q-value as curves."""
        rerun = self._rerun
        rerun.set_time("agent step", sequence=self._agent_step)
        self._agent_step += 1
        rerun.log("panels", rerun.Image(panels).compress(jpeg_quality=_QUALITY))
        rerun.log("score", rerun.Scalars(score))
        if values is not None:
            rerun.log("max_q", rerun.Scalars(float(values.max())))


def _import_rerun() -> ModuleType:
    try:
        import rerun
    except ModuleNotFoundError as error:
        package = "rerun-sdk" if error.name == "rerun" else error.name
        raise InputError(
            f"--viewer rerun needs the package {package}, which is not installed: "
            f"pip install {package}."
        ) from None
    module: ModuleType = rerun
    return module


def _viewer_runs() -> bool:
    try:
        socket.create_connection(_VIEWER, 1.0).close()
    except OSError:
        return False
    return True


def _start_viewer(rerun: ModuleType) -> None:
    on_screen = sys.platform != "linux" or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))
    # Beside this Python, too, whose folder is not on the path unless it was activated.
    places = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    program = shutil.which("rerun", path=places)
    if not on_screen or program is None:
        raise InputError(
            f"--viewer rerun cannot open a window here: start `{program or 'rerun'} --serve-web`, "
            "look at it in a browser, and try again."
        )
    rerun.spawn(executable_path=program)
