"""Pictures and figures streamed live to the Rerun viewer, where the extra `viz` is installed."""

from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from actors.looking.glance import Glance
from common.errors import InputError


class RerunStream:
    """Starts a viewer, or finds the one that runs, and sends it every glance.

    Raises:
        InputError: Rerun is not installed.
    """

    def __init__(self) -> None:
        self._rerun = _import_rerun()
        self._rerun.init("ale-robot", spawn=True)
        self._decision = 0

    def show(self, glance: Glance, panels: NDArray[np.uint8]) -> None:
        """Send the panels, and score and greatest value as curves."""
        rerun = self._rerun
        rerun.set_time("decision", sequence=self._decision)
        self._decision += 1
        rerun.log("panels", rerun.Image(panels))
        rerun.log("score", rerun.Scalars(glance.score))
        if glance.values is not None:
            rerun.log("max_q", rerun.Scalars(float(glance.values.max())))


def _import_rerun() -> ModuleType:
    try:
        import rerun
    except ImportError:
        raise InputError(
            "--viewer rerun needs the package rerun-sdk, which is not installed: "
            "pip install 'ale-robot[viz]'."
        ) from None
    module: ModuleType = rerun
    return module
