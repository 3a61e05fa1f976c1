"""What hands were told and did, frame by frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actors.robots.latency_model.weights import ACTIONS, COMMANDS, ROW


@dataclass(frozen=True)
class Recording:
    """What hands did in ``N`` emulator frames, as ALE's actions."""

    wanted: NDArray[np.int64]
    """``[N]``, the command in each frame."""
    held: NDArray[np.int64]
    """``[N]``, what was held at the end of each frame."""
    known_from: int = 0
    """First frame before which all commands of a model's memory are known."""


def inputs(recording: Recording) -> NDArray[np.int64]:
    """Returns the columns of the model's first layer that are 1 in each frame, ``[N, 60]``: the
    last 30 commands, and what was held just before each of them."""
    before = np.concatenate([[0], recording.held[:-1]])
    columns = np.stack([recording.wanted, ACTIONS + before], axis=1)
    nothing = np.tile([0, ACTIONS], (COMMANDS - 1, 1))
    past = np.lib.stride_tricks.sliding_window_view(
        np.concatenate([nothing, columns]), COMMANDS, axis=0
    )
    return (past + ROW * np.arange(COMMANDS)).reshape(len(columns), 2 * COMMANDS)
