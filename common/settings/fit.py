"""Checks that a network fits the settings under which it should play or learn."""

import shlex
from collections.abc import Callable
from dataclasses import fields, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

from common.errors import InputError
from common.pinned_file import path_of
from common.registry import ALGORITHMS
from common.settings.conditions import PlayConfig
from common.settings.config import LearningConfig, RunConfig
from common.settings.stored_config import flag_of

VECTOR_PARTS = [f"play.{f.name}" for f in fields(PlayConfig) if f.name.startswith("vector_")]
"""Settings of the contents of the vector observation, which mean nothing without it."""
VECTOR_SETTINGS = ("play.vector", *VECTOR_PARTS)
"""These and the vector itself, without the robot's number of joints."""
_VECTOR = ("play.robot", *VECTOR_SETTINGS, "play.env_settings")
_SHAPING: tuple[tuple[str, Callable[[RunConfig], Any], tuple[str, ...]], ...] = (
    (
        "{} actions",
        lambda config: config.action_count,
        ("game", "play.minimal_actions", "play.env_settings"),
    ),
    ("{} numbers of proprioception", lambda config: config.vector_width, _VECTOR),
    ("{} frames per state", lambda config: config.play.frame_stack, ("play.frame_stack",)),
    (
        "{} outputs per action",
        lambda config: ALGORITHMS.find(config.learning.algorithm).atoms(config.learning),
        ("learning.algorithm", "learning.algorithm_settings", "learning.quantiles"),
    ),
    (
        "layers of {}",
        lambda config: (
            f"{config.learning.network}{', normalised' if config.learning.layer_norm else ''}"
        ),
        ("learning.network", "learning.layer_norm"),
    ),
    (
        "pixels that are {}",
        lambda config: _pixels_are(config.learning),
        ("learning.scale_pixels", "learning.center_pixels", "learning.frame_differences"),
    ),
)
"""Properties that a network's weights need: its shape, and the form of its pixels. Each has words
for people, a function that measures it, and the settings that it follows from."""
SHAPING_SETTINGS = frozenset(name for _, _, settings in _SHAPING for name in settings)
"""Settings that must be those of a network's training for its weights to fit."""


def shaped_like(trained: RunConfig, config: RunConfig) -> RunConfig:
    """Returns ``config`` with the outputs per action, the layers and the form of the pixels of a
    network's training. What is played stays: the game, its actions and the observation."""
    group = "learning."
    names = [name.removeprefix(group) for name in SHAPING_SETTINGS if name.startswith(group)]
    found = {name: getattr(trained.learning, name) for name in names}
    return replace(config, learning=replace(config.learning, **found))


def _pixels_are(learning: LearningConfig) -> str:
    changes = {
        "scaled": learning.scale_pixels,
        "centred": learning.center_pixels,
        "differenced": learning.frame_differences,
    }
    *others, last = [name for name, done in changes.items() if done] or ["as they are"]
    return f"{', '.join(others)} and {last}" if others else last


def as_flag(setting: str, config: RunConfig) -> str:
    """Returns the flag that gives ``setting`` its value in ``config``."""
    value = attrgetter(setting)(config)
    if setting == "play.robot":
        return f"--robot {shlex.quote(str(path_of(value)))}"
    return shlex.join(flag_of(setting, value))


def as_argument(setting: str, config: RunConfig) -> str:
    """Returns ``setting`` and its value in ``config`` as an argument of Python: ``game='pong'``."""
    return f"{setting}={attrgetter(setting)(config)!r}"


def check_fit(
    weights: Path,
    trained: RunConfig | None,
    config: RunConfig,
    *,
    vector: bool = True,
    written: Callable[[str, RunConfig], str] = as_flag,
) -> None:
    """Checks that a network fits the settings ``config`` under which it should play or learn.
    Raises InputError, with the settings under which it fits, if it does not.

    Args:
        trained: settings under which ``weights`` were trained; None if they are unknown.
        vector: whether the vector observation must fit too.
        written: writes the name and the value of a setting for people.
    """
    if trained is None:
        return
    needs: list[str] = []
    has: list[str] = []
    flags: list[str] = []
    for words, measure, settings in _SHAPING:
        needed, given = measure(trained), measure(config)
        if needed != given and (vector or settings is not _VECTOR):
            needs.append(words.format(needed))
            has.append(words.format(given))
            values = [(name, attrgetter(name)) for name in settings]
            found = [written(name, trained) for name, of in values if of(trained) != of(config)]
            flags += found or [written("env", trained)]
    if flags:
        other = "" if trained.game == config.game else f", or name a network of {config.game}"
        raise InputError(
            f"{weights}, which plays {trained.played}, was trained with "
            f"{', '.join(needs)}, and here it would have {', '.join(has)}: give "
            f"{' '.join(dict.fromkeys(flags))}{other}."
        )
