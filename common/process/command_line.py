"""The command lines of all programs, generated from dataclasses by tyro.

The preset is read first and gives the defaults of all other flags, so `--help` shows the values
that a run would really use.
"""

import contextlib
import dataclasses
import inspect
import io
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

import tyro

from common.checked import Count, FromOne, Invalid, build
from common.errors import InputError, choice
from common.process.config_file import with_file
from common.process.exit_codes import table
from common.process.first_flags import read_first
from common.process.flag_errors import as_sentence
from common.process.help_text import wrapped
from common.process.own_flags import going_on_from, own_help
from common.registry import ENVIRONMENTS
from common.run.config import RunConfig
from common.run.fit import shaped_like
from common.run.folder import RUNS
from common.run.origin import find_weights, origin_of
from common.run.presets import PRESETS
from common.run.ranges import all_ranges
from common.run.rules import check_config, check_robot
from common.run.stored_config import REMOVED, RENAMED, flag_of, flat
from common.transport.endpoint import DEFAULT_ENDPOINT
from common.transport.leaky_bucket import ACTOR_QUOTA
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
"""A network, as `common.run.origin.find_weights` finds it."""

ALL_RANGES = "--randomise.all"
"""Flag that sets the published range of everything that can be drawn for each game."""

T = TypeVar("T")


def preset_of(arguments: Sequence[str]) -> RunConfig:
    """Returns the preset that ``arguments`` ask for by ``--preset``, or else that of ``--env``."""
    known, _ = read_first(arguments, {"preset": ["--preset"], "env": ["--env"]})
    name = known.get("preset") or ENVIRONMENTS.find(known.get("env") or RunConfig.env).preset
    if name not in PRESETS:
        raise InputError(f"there is no preset {name!r}: {choice(name, list(PRESETS))}")
    return PRESETS[name]


@dataclasses.dataclass(frozen=True)
class RunOptions:
    """Options that the command lines of learner and replay share."""

    config: RunFlags
    runs: Path = RUNS
    """Folder that holds the runs."""
    resume: bool = False
    """Resume the run of that name, with its own settings."""
    initial: WeightsFile | None = None
    """Network to begin with, such as ale_pong or a FILE, instead of a fresh one. The run then has
    its layers, whatever the preset; --exploration.start sets how much of its play is random at
    first."""
    listen: str = DEFAULT_ENDPOINT
    """Address at which the run's other processes reach this one; 0.0.0.0 lets other machines in."""
    certificates: Path | None = None
    """Folder of the certificates, for an address that begins with tls/; see deploy/README.md."""
    actor_quota: FromOne = ACTOR_QUOTA
    """Maximum number of steps per second that the replay in this process accepts from one actor;
    more have to wait."""
    log_json: bool = False
    """Output as lines of JSON instead of a screen or plain lines."""
    restart: Count = 0
    """Maximum number of restarts in a row after a crash. A parent process starts this one again,
    with --resume and growing pauses, unless the exit code says that a restart cannot help."""
    http: str | None = None
    """Address that serves /healthz, /readyz and /metrics, such as 127.0.0.1:9108; see
    docs/operations.md."""

    def defaults(self, preset: RunConfig) -> RunConfig:
        """Returns the defaults of a new run's settings: those of its ``preset``, with the layers of
        the --initial network. Raises InputError if that network's settings cannot be read."""
        trained = None if self.initial is None else origin_of(self.initial)
        return preset if trained is None else shaped_like(trained, preset)


R = TypeVar("R", bound=RunOptions)


def parse_run(
    kind: type[R],
    program: str,
    arguments: Sequence[str],
    stored: Callable[[R], RunConfig | None],
) -> R:
    """Parses as `parse` does, with the defaults of a stored run, or else those that the options
    have for their preset.

    `ALL_RANGES` sets the default of every range. Raises InputError for an unknown preset, or for
    settings that cannot work.

    Args:
        stored: returns the stored configuration of the run that the options resume; None for a new
            run.
    """
    arguments = with_file(arguments)
    flags = [argument for argument in arguments if argument != ALL_RANGES]
    preset = preset_of(flags)
    options = parse(kind, program, flags, own_help(flags), config=preset)
    found = stored(options)
    defaults = found or options.defaults(preset)
    if defaults != preset:
        flags = going_on_from(flat(defaults), flags)
        options = parse(kind, program, flags, config=defaults)
    if ALL_RANGES in arguments:
        drawn = dataclasses.replace(defaults, randomise=all_ranges(options.config.env))
        options = parse(kind, program, flags, config=drawn)
    check_config(options.config)
    check_robot(defaults, options.config)
    config = options.config.pinned()
    if config != found:  # a stored run goes on, even if a new version of a package declares more
        config = config.in_full()
    return dataclasses.replace(options, config=config)


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
    arguments = with_file(arguments)
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


def flag_named(name: str) -> str:
    """Returns the flag of a field."""
    return f"--{name.replace('_', '-')}"


def check_bounds(options: Any, named: Callable[[str], str] = flag_named) -> None:
    """Checks each option against the bounds beside its field.

    Groups are skipped, because they check themselves, and so are texts, which may be long on a
    command line. Raises InputError with what to choose, for the option as it is ``named``.
    """
    hints = get_type_hints(type(options), include_extras=True)
    for name in (field.name for field in dataclasses.fields(options)):
        value = getattr(options, name)
        if not (dataclasses.is_dataclass(value) or isinstance(value, str)):
            try:
                build(hints[name], value, named(name))
            except Invalid as error:
                raise InputError(f"{error}.") from None


PRESENT_FLAGS = {
    flag_of(former, on)[0]: flag_of(present, on)[0]
    for former, present in RENAMED.items()
    for on in (True, False)
}
"""Present names of flags by their former names, which tables of earlier results still use."""
_GONE = {flag_of(field, on)[0] for field in REMOVED for on in (True, False)}


def _refuse_former_flags(arguments: Sequence[str]) -> None:
    """Raises InputError for a flag of a former version, with its present name if there is one."""
    for argument in arguments:
        former = argument.partition("=")[0].replace("_", "-")
        if former in _GONE:
            raise InputError(f"{former} is gone, because no result was better with it: omit it.")
        if former in PRESENT_FLAGS:
            raise InputError(f"{former} is now called {PRESENT_FLAGS[former]}: use that name.")


def _refuse_flags_of_others(kind: Any, arguments: Sequence[str]) -> None:
    """Raises InputError for a flag that ``kind`` knows as another program's, with what to do."""
    elsewhere: Mapping[str, str] = getattr(kind, "ELSEWHERE", {})
    for argument in arguments:
        flag = argument.partition("=")[0].replace("_", "-")
        if flag in elsewhere:
            raise InputError(f"{flag} {elsewhere[flag]}.")
