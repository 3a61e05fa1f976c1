"""The command lines of all programs, generated from dataclasses by tyro."""

import contextlib
import dataclasses
import inspect
import io
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

import tyro

from common.command_line.first_flags import read_first
from common.command_line.flag_errors import as_sentence
from common.command_line.help_text import wrapped
from common.errors import InputError
from common.exit_codes import table
from common.run.origin import find_weights
from common.settings.stored_config import INSTEAD, REMOVED, RENAMED, flag_of, from_mapping
from common.version import VERSION

WeightsFile = Annotated[
    Path,
    tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="FILE",
        instance_from_str=lambda given: find_weights(given[0]),
        is_instance=lambda value: isinstance(value, Path),
        str_from_instance=lambda value: [str(value)],
    ),
]
"""A network, as `common.run.origin.find_weights` finds it."""

T = TypeVar("T")


def started_by(module: str) -> str:
    """Returns the command that started this program, without its flags. `ale-robot` puts its own
    name and subcommand in ``sys.argv[0]``."""
    return sys.argv[0] if sys.argv[0].startswith("ale-robot ") else f"python -m {module}"


def without_flags(
    arguments: Sequence[str], valued: Sequence[str], plain: Sequence[str]
) -> list[str]:
    """Returns ``arguments`` without the flags ``valued``, which have a value, and ``plain``."""
    _, rest = read_first(arguments, {flag: [flag] for flag in valued})
    return [argument for argument in rest if argument not in plain]


def parse(
    kind: type[T], program: str, arguments: Sequence[str], more: str = "", **defaults: Any
) -> T:
    """Returns a ``kind`` filled from the command line, with the other fields from ``defaults``.
    Its help begins with what it is, and ``more``.

    Raises:
        SystemExit: code 0 after ``--help`` and ``--version``.
        InputError: a flag is unknown, lacks its value, or is out of the bounds beside its field; or
            it is another program's, as the ``ELSEWHERE`` of ``kind`` says.
    """
    if "--version" in arguments:
        print(f"ale-robot {VERSION}")
        raise SystemExit(0)
    _refuse_former_flags(arguments)
    _refuse_flags_of_others(kind, arguments)
    given: dict[str, Any] = {"default": kind(**defaults)} if defaults else {}
    command = started_by(program)
    with contextlib.redirect_stderr(io.StringIO()) as told:
        try:
            # A union of commands has no docstring but Python's own.
            does = (kind.__doc__ or "") if isinstance(kind, type) else ""
            about = wrapped(f"{inspect.cleandoc(does)}\n\n{more}Exit codes:\n\n{table()}")
            parsed: T = tyro.cli(
                kind, prog=command, description=about, args=list(arguments), **given
            )
        except SystemExit as left:
            if not left.code:
                raise
            flag = "--help-all" if command.startswith("ale-robot ") else "--help"
            raise InputError(as_sentence(told.getvalue(), f"{command} {flag}")) from None
    check_bounds(parsed)
    return parsed


def check_bounds(options: Any) -> None:
    """Checks each flag against the bounds beside its field.

    Groups are skipped, because they check themselves, and so are texts, which may be long on a
    command line. Raises InputError with the flag and what to choose.
    """
    hints = get_type_hints(type(options), include_extras=True)
    for name in (field.name for field in dataclasses.fields(options)):
        value = getattr(options, name)
        if not (dataclasses.is_dataclass(value) or isinstance(value, str)):
            from_mapping(hints[name], value, f"--{name.replace('_', '-')}")


PRESENT_FLAGS = {
    flag_of(former, on)[0]: flag_of(present, on)[0]
    for former, present in RENAMED.items()
    for on in (True, False)
}
"""Present names of flags by their former names, which tables of earlier results still use."""
_GONE = {flag_of(field, on)[0]: INSTEAD.get(field) for field in REMOVED for on in (True, False)}
"""What does the same now, by flags that are gone; None if nothing does."""


def flag_in(argument: str) -> str:
    """Returns the flag in an argument of a command line, as help writes it; other arguments as they
    are."""
    return argument.partition("=")[0].replace("_", "-")


def _refuse_former_flags(arguments: Sequence[str]) -> None:
    """Raises InputError for a flag of a former version, with its present name if there is one."""
    for argument in arguments:
        former = flag_in(argument)
        if (instead := _GONE.get(former)) is not None:
            flag, _ = flag_of(instead, 0)
            raise InputError(
                f"{former} is gone: give {flag}, in emulator frames instead of agent steps."
            )
        if former in _GONE:
            raise InputError(f"{former} is gone, because no result was better with it: omit it.")
        if former in PRESENT_FLAGS:
            raise InputError(f"{former} is now called {PRESENT_FLAGS[former]}: use that name.")


def _refuse_flags_of_others(kind: Any, arguments: Sequence[str]) -> None:
    """Raises InputError for a flag that ``kind`` knows as another program's, with what to do."""
    elsewhere: Mapping[str, str] = getattr(kind, "ELSEWHERE", {})
    for argument in arguments:
        flag = flag_in(argument)
        if flag in elsewhere:
            raise InputError(f"{flag} {elsewhere[flag]}.")
