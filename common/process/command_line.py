"""The command lines of learner and replay, generated from dataclasses by tyro.

A preset is read first and becomes the default of every other flag, so `--help` shows the values
that would really be used.
"""

import argparse
from collections.abc import Callable, Sequence
from typing import Annotated, Any, Protocol, TypeVar

import tyro

from common.errors import InputError
from common.registry import ENVIRONMENTS
from common.run.config import RENAMED, RunConfig
from common.run.presets import PRESETS

RunFlags = Annotated[RunConfig, tyro.conf.arg(name="")]
"""A `RunConfig` field whose flags carry no prefix: ``--game``, ``--learning.n-step``."""

T = TypeVar("T")


def preset_of(arguments: Sequence[str]) -> RunConfig:
    """The preset that ``arguments`` ask for: ``--preset``, or else what suits ``--env``."""
    first = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    first.add_argument("--preset")
    first.add_argument("--env")
    known, _ = first.parse_known_args(list(arguments))
    name = known.preset or ENVIRONMENTS.find(known.env or RunConfig.env).preset
    if name not in PRESETS:
        raise InputError(f"there is no preset {name!r}: choose one of {', '.join(PRESETS)}.")
    return PRESETS[name]


class RunOptions(Protocol):
    """What the command lines of learner and replay have in common."""

    @property
    def config(self) -> RunConfig: ...


R = TypeVar("R", bound=RunOptions)


def parse_run(
    kind: type[R],
    program: str,
    arguments: Sequence[str],
    stored: Callable[[R], RunConfig | None],
) -> R:
    """As `parse`, with the defaults of a preset, or of a run that is there.

    Args:
        stored: finds the configuration of the run that the flags go on with; None for a new one.

    Raises:
        InputError: no such preset, or settings that cannot work.
    """
    options = parse(kind, program, arguments, config=preset_of(arguments))
    if (config := stored(options)) is not None:
        options = parse(kind, program, arguments, config=config)
    options.config.check()
    return options


def parse(kind: type[T], program: str, arguments: Sequence[str], **defaults: Any) -> T:
    """A ``kind`` filled from the command line, its other fields from ``defaults``.

    Raises:
        SystemExit: code 2 and a message for flags that are not known; 0 after ``--help``.
    """
    _refuse_former_names(arguments)
    parsed: T = tyro.cli(
        kind, prog=f"python -m {program}", args=list(arguments), default=kind(**defaults)
    )
    return parsed


def _flag(field: str, negation: str = "") -> str:
    group, name = field.replace("_", "-").split(".")
    return f"--{group}.{negation}{name}"


PRESENT_FLAGS = {
    _flag(former, negation): _flag(present, negation)
    for former, present in RENAMED.items()
    for negation in ("", "no-")
}
"""Flags by their former names, as tables of earlier results have them, and the present ones."""


def _refuse_former_names(arguments: Sequence[str]) -> None:
    """Raises InputError, with the present name, for a flag that a former version had."""
    for argument in arguments:
        former = argument.partition("=")[0].replace("_", "-")
        if former in PRESENT_FLAGS:
            raise InputError(f"{former} is called {PRESENT_FLAGS[former]} now: write it so.")
