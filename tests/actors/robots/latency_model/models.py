"""Latency models whose keys are known by hand, and the format's function written plainly."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, NDArray[np.float32]]


def delay(commands: int) -> Arrays:
    """A model whose action is the command of so many thirtieths of a second ago."""
    fc_weight = np.zeros((18, 30, 36), np.float32)
    fc_weight[np.arange(18), 29 - commands, np.arange(18)] = 1
    return {
        "fc_weight": fc_weight.reshape(18, 1080),
        "fc_bias": np.zeros(18, np.float32),
        "pred_weight": np.eye(18, dtype=np.float32),
        "pred_bias": np.zeros(18, np.float32),
    }


def flicker() -> Arrays:
    """A model that fires at a command to fire, but never twice in a row: it adds 1 for the command
    and takes 1 off for having fired just now. UP falls out for its negative hidden unit."""
    fc_weight = np.zeros((2, 30, 36), np.float32)
    fc_weight[0, 29, 1], fc_weight[0, 29, 18 + 1] = 1, -1
    fc_weight[1, 29, 2] = -1
    pred_weight = np.zeros((18, 2), np.float32)
    pred_weight[1, 0], pred_weight[2, 1] = 1, -9
    pred_bias = np.full(18, -1, np.float32)
    pred_bias[0] = 0.25
    return {
        "fc_weight": fc_weight.reshape(2, 1080),
        "fc_bias": np.array([0.5, 0], np.float32),
        "pred_weight": pred_weight,
        "pred_bias": pred_bias,
    }


def drawn(hidden: int, seed: int) -> Arrays:
    """A model of random weights that leans on old commands and on its own actions."""
    rng = np.random.default_rng(seed)
    return {
        "fc_weight": rng.normal(size=(hidden, 1080)).astype(np.float32),
        "fc_bias": rng.normal(size=hidden).astype(np.float32),
        "pred_weight": rng.normal(size=(18, hidden)).astype(np.float32),
        "pred_bias": rng.normal(size=18).astype(np.float32),
    }


def plain(arrays: Arrays, commands: list[int]) -> list[int]:
    """The action that each command leads to, by whole products with the whole past."""
    past, taken, actions = [(0, 0)] * 30, 0, []
    for command in commands:
        past = [*past[1:], (command, taken)]
        x = np.zeros(1080)
        for place, (wanted, given) in enumerate(past):
            x[36 * place + wanted] = x[36 * place + 18 + given] = 1
        hidden = arrays["fc_weight"].astype(float) @ x + arrays["fc_bias"]
        hidden[hidden < 0] = 0
        taken = int(np.argmax(arrays["pred_weight"].astype(float) @ hidden + arrays["pred_bias"]))
        actions.append(taken)
    return actions


def together(*copies: Arrays) -> Arrays:
    """A file's arrays of several copies."""
    return {name: np.stack([copy[name] for copy in copies]) for name in copies[0]}


def saved(path: Path, arrays: Arrays) -> str:
    """Writes the file; returns its name."""
    np.savez(path, **arrays)  # type: ignore[arg-type]
    return str(path)
