"""The command lines of all programs, generated from dataclasses by tyro.

A preset is read first and becomes the default of every other flag, so `--help` shows the values
that would really be used.
"""

import argparse
import contextlib
import dataclasses
import inspect
import io
import json
import re
import sys
import tomllib
from collections.abc import Callable, Sequence
from itertools import chain, dropwhile, takewhile
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

import tyro
from tyro import _strings

from common.checked import Count, FromOne, Invalid, build
from common.errors import InputError, choice
from common.process.exit_codes import table
from common.registry import ENVIRONMENTS
from common.regular_file import read_file
from common.run.config import RunConfig, all_ranges
from common.run.origin import find_weights
from common.run.presets import PRESETS
from common.run.stored_config import REMOVED, RENAMED, flag_of, from_mapping, settings
from common.transport.endpoint import DEFAULT_ENDPOINT
from common.transport.leaky_bucket import STEPS_PER_SECOND
from common.version import VERSION

RunFlags = Annotated[RunConfig, tyro.conf.arg(name="")]
"""A `RunConfig` field whose flags carry no prefix: ``--game``, ``--learning.n-step``."""

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
"""A network by its file, or a published one by its name."""

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
        raise InputError(f"there is no preset {name!r}: {choice(name, list(PRESETS))}")
    return PRESETS[name]


@dataclasses.dataclass(frozen=True)
class RunOptions:
    """What the command lines of learner and replay have in common."""

    config: RunFlags
    runs: Path = Path("runs")
    """Folder that holds the runs."""
    resume: bool = False
    """Resume the run of that name, under its own settings."""
    listen: str = DEFAULT_ENDPOINT
    """Address where the run's other processes find this one; name 0.0.0.0 to let other machines
    in."""
    certificates: Path | None = None
    """Folder of certificates, where the address begins with tls/; see deploy/README.md."""
    actor_quota: FromOne = STEPS_PER_SECOND
    """Steps per second that the replay in this process takes of one actor at most; the rest has to
    wait."""
    log_json: bool = False
    """Lines of JSON instead of a screen or lines for people."""
    restart: Count = 0
    """Restarts in a row after a crash: a parent process starts this one again, with --resume and
    growing pauses, unless the exit code says that this is in vain."""
    http: str | None = None
    """Address such as 127.0.0.1:9108 of /healthz, /readyz and /metrics; see docs/operations.md."""


R = TypeVar("R", bound=RunOptions)


def parse_run(
    kind: type[R],
    program: str,
    arguments: Sequence[str],
    stored: Callable[[R], RunConfig | None],
) -> tuple[R, RunConfig | None]:
    """As `parse`, with the defaults of a preset, or of a run that is there; `ALL_RANGES` sets the
    default of every range. Raises InputError if there is no such preset, or for settings that
    cannot work.

    Args:
        stored: finds the configuration of the run that the flags go on with; None for a new one.

    Returns:
        the options, and what ``stored`` found.
    """
    arguments = with_file(arguments)
    flags = [argument for argument in arguments if argument != ALL_RANGES]
    preset = preset_of(flags)
    options = parse(kind, program, flags, config=preset)
    if (found := stored(options)) is not None:
        options = parse(kind, program, flags, config=found)
    if len(flags) < len(arguments):
        drawn = dataclasses.replace(found or preset, randomise=all_ranges(options.config.env))
        options = parse(kind, program, flags, config=drawn)
    options.config.check()
    pinned = dataclasses.replace(options, config=options.config.pinned())
    return pinned, found


def started_by(module: str) -> str:
    """Returns the command that started this program, without its flags: `ale-robot` leaves its own
    in the place of a file's name."""
    return sys.argv[0] if sys.argv[0].startswith("ale-robot ") else f"python -m {module}"


def parse(kind: type[T], program: str, arguments: Sequence[str], **defaults: Any) -> T:
    """A ``kind`` filled from the command line, its other fields from ``defaults``.

    Raises:
        SystemExit: code 0 after ``--help`` and ``--version``.
        InputError: a flag is not known, lacks its value, or is beyond the bounds beside its field.
    """
    if "--version" in arguments:
        print(f"ale-robot {VERSION}")
        raise SystemExit(0)
    arguments = with_file(arguments)
    _refuse_former_flags(arguments)
    given: dict[str, Any] = {"default": kind(**defaults)} if defaults else {}
    command = started_by(program)
    with contextlib.redirect_stderr(io.StringIO()) as told:
        try:
            # The docstring of a union of commands is Python's own.
            does = _joined_lines(kind.__doc__ or "") if isinstance(kind, type) else ""
            about = f"{does}\n\nExit codes:\n\n{table()}"
            parsed: T = tyro.cli(
                kind, prog=command, description=about, args=list(arguments), **given
            )
        except SystemExit as left:
            if not left.code:
                raise
            raise InputError(_sentence(told.getvalue(), command)) from None
    check_bounds(parsed)
    return parsed


def _sentence(box: str, command: str) -> str:
    """Returns what tyro says in a box as one sentence."""
    # Without UTF-8 it has no border, and its rules are of "-".
    _, *lines = (line.strip("│╭╮╰╯─ ") for line in box.strip().splitlines())
    body = dropwhile(_is_rule, lines)
    first = " ".join(takewhile(lambda line: not _is_rule(line), body))
    if "Unrecognized" not in box:
        return f"{_plainly(first)} `{command} --help` explains the flags."
    unknown = first.removeprefix("Unrecognized options: ").partition(",")[0]
    flags = [line for line in lines if line.startswith("--") and not _is_rule(line)]
    alike = [line.split()[0].strip(",") for line in flags]
    hint = f"did you mean {alike[0]}?" if alike else f"`{command} --help` lists the flags."
    if not unknown.startswith("-"):
        return f"{unknown} stands without a flag: {hint}"
    return f"there is no flag {unknown}: {hint}"


_SAID = {
    r"Error parsing (\S+): invalid literal for int\(\) with base 10: (.*)": (
        r"\1 is \2: give a whole number;"
    ),
    r"Error parsing (\S+): could not convert string to float: (.*)": r"\1 is \2: give a number;",
    r"(?:Error parsing )?(\S+): no type matching \S+\|INT could be .* from \['(.*)'\].*": (
        r"\1 is '\2': give a whole number;"
    ),
    r"[Ii]nvalid choice (.*) for argument '(\S+)'\. Expected one of \((.*)\)\.": (
        r"\2 is \1: choose one of \3;"
    ),
    r"Missing value for argument '(\S+)'.*": r"\1 needs a value:",
    r"Missing from .*?: \{(.*?)\} (.*?)\.? \(required\).*": r"name one of \1 (\2):",
    r"Missing from .*?: STR (.*?)\.? \(required\).*": r"a name is missing (\1):",
    # Of several, the first.
    r"Missing from .*?: ((?:(?:-\S+|STR,|PATH,) )*)(STR|PATH|FILE) (.*?)\.? \(required\).*": (
        r"\1\2 is missing (\3):"
    ),
}
"""What tyro says, and the same for people."""


def _plainly(said: str) -> str:
    """Returns the beginning of a sentence that goes on with a command."""
    said = re.sub(r"\{.*?\}", lambda names: names[0].replace(",", ", "), said)
    for pattern, plainly in _SAID.items():
        if found := re.fullmatch(pattern, said):
            return found.expand(plainly)
    return f"{said.removeprefix('Error parsing ').rstrip('.')}:"


def _is_rule(line: str) -> bool:
    return not line.strip("-")


def with_file(arguments: Sequence[str]) -> list[str]:
    """Returns ``arguments`` with the flags that a ``--config FILE`` stands for before all others,
    which therefore win.

    The file is TOML whose tables are groups of flags, the ``config.json`` of a run, or the card of
    a policy. Raises InputError if it cannot be read.
    """
    first = argparse.ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
    first.add_argument("--config", type=Path)
    try:
        known, rest = first.parse_known_args(list(arguments))
    except argparse.ArgumentError:
        raise InputError("--config names a file of settings: add it, as --config FILE.") from None
    if known.config is None:
        return list(arguments)
    try:
        text = read_file(known.config).decode()
        told = json.loads(text) if known.config.suffix == ".json" else tomllib.loads(text)
    except OSError as error:
        raise InputError(f"--config {known.config} cannot be read: {error.strerror}.") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"--config {known.config} cannot be read: {error}.") from None
    if known.config.suffix == ".json":
        stored = told.get("config", told) if isinstance(told, dict) else told
        told = dataclasses.asdict(from_mapping(RunConfig, stored, str(known.config), fill=True))
    elif "config" in told:
        raise InputError(f"{known.config} names a file of settings itself: remove config from it.")
    flags = (flag_of(name, value) for name, value in settings(told) if value is not None)
    return [*chain.from_iterable(flags), *rest]


def check_bounds(options: Any) -> None:
    """Refuses a flag that is beyond the bounds beside its field.

    Groups check themselves, and a text of the command line may be long. Raises InputError with the
    flag and what to choose.
    """
    for name, hint in get_type_hints(type(options), include_extras=True).items():
        value = getattr(options, name)
        if not (dataclasses.is_dataclass(value) or isinstance(value, str)):
            try:
                build(hint, value, f"--{name.replace('_', '-')}")
            except Invalid as error:
                raise InputError(f"{error}.") from None


PRESENT_FLAGS = {
    flag_of(former, on)[0]: flag_of(present, on)[0]
    for former, present in RENAMED.items()
    for on in (True, False)
}
"""Flags by their former names, as tables of earlier results have them, and the present ones."""
_GONE = {flag_of(field, on)[0] for field in REMOVED for on in (True, False)}


def _refuse_former_flags(arguments: Sequence[str]) -> None:
    """Raises InputError for a flag that a former version had, with its present name if any."""
    for argument in arguments:
        former = argument.partition("=")[0].replace("_", "-")
        if former in _GONE:
            raise InputError(f"{former} is gone, because no result was better with it: omit it.")
        if former in PRESENT_FLAGS:
            raise InputError(f"{former} is called {PRESENT_FLAGS[former]} now: write it so.")
