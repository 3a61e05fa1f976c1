"""The command lines of all programs, generated from dataclasses by tyro.

A preset is read first and becomes the default of every other flag, so `--help` shows the values
that would really be used.
"""

import argparse
import dataclasses
import inspect
import re
from collections.abc import Callable, Sequence
from typing import Annotated, Any, Protocol, TypeVar, get_type_hints

import tyro
from tyro import _strings

from common.checked import Invalid, build
from common.errors import InputError
from common.registry import ENVIRONMENTS
from common.run.config import RunConfig, all_ranges
from common.run.presets import PRESETS
from common.run.stored_config import RENAMED

RunFlags = Annotated[RunConfig, tyro.conf.arg(name="")]
"""A `RunConfig` field whose flags carry no prefix: ``--game``, ``--learning.n-step``."""

ALL_RANGES = "--randomise.all"
"""Flag of the published ranges of everything that is drawn for each game."""

T = TypeVar("T")


def _joined_lines(helptext: str) -> str:
    """Returns each paragraph of ``helptext`` as one line, for tyro to wrap."""
    return re.sub(r"(?<!\n)\n(?!\n)", " ", inspect.cleandoc(helptext))


# tyro's own keeps the line breaks of a field's docstring, because its lines are indented.
_strings.remove_single_line_breaks = _joined_lines


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
) -> tuple[R, RunConfig | None]:
    """As `parse`, with the defaults of a preset, or of a run that is there; `ALL_RANGES` sets the
    default of every range.

    Args:
        stored: finds the configuration of the run that the flags go on with; None for a new one.

    Returns:
        the options, and what ``stored`` found.

    Raises:
        InputError: no such preset, or settings that cannot work.
    """
    flags = [argument for argument in arguments if argument != ALL_RANGES]
    preset = preset_of(flags)
    options = parse(kind, program, flags, config=preset)
    if (found := stored(options)) is not None:
        options = parse(kind, program, flags, config=found)
    if len(flags) < len(arguments):
        drawn = dataclasses.replace(found or preset, randomise=all_ranges(options.config.env))
        options = parse(kind, program, flags, config=drawn)
    options.config.check()
    pinned = dataclasses.replace(options, config=options.config.pinned())  # type: ignore[type-var]
    return pinned, found


def parse(kind: type[T], program: str, arguments: Sequence[str], **defaults: Any) -> T:
    """A ``kind`` filled from the command line, its other fields from ``defaults``.

    Raises:
        SystemExit: code 2 and a message for flags that are not known; 0 after ``--help``.
        InputError: a flag is beyond the bounds beside its field.
    """
    _refuse_former_names(arguments)
    given: dict[str, Any] = {"default": kind(**defaults)} if defaults else {}
    parsed: T = tyro.cli(kind, prog=f"python -m {program}", args=list(arguments), **given)
    check_bounds(parsed)
    return parsed


def check_bounds(options: Any) -> None:
    """Refuses a flag that is beyond the bounds beside its field.

    Groups check themselves, and a text of the command line may be long.

    Raises:
        InputError: with the flag and what to choose.
    """
    for name, hint in get_type_hints(type(options), include_extras=True).items():
        value = getattr(options, name)
        if not (dataclasses.is_dataclass(value) or isinstance(value, str)):
            try:
                build(hint, value, f"--{name.replace('_', '-')}")
            except Invalid as error:
                raise InputError(f"{error}.") from None


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
