"""The command lines of learner and replay: the settings of a run, from its preset, and the options
that both programs have.

The preset, a stored run or a first network gives the defaults of all other flags, so `--help` shows
the values that a run would really use.
"""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, TypeVar

import tyro

from common.checked import Count, FromOne
from common.command_line.config_file import with_file
from common.command_line.first_flags import read_first
from common.command_line.flag_errors import naming_flags
from common.command_line.own_flags import ALL_RANGES, HELP, going_on_from, own_help
from common.command_line.parser import WeightsFile, parse
from common.endpoint import DEFAULT_ENDPOINT
from common.errors import InputError, choice
from common.registry import ENVIRONMENTS
from common.run.folder import RUNS
from common.run.origin import origin_of
from common.run.rules import check_chosen, check_config
from common.settings.config import RunConfig
from common.settings.fit import shaped_like
from common.settings.presets import PRESETS
from common.settings.ranges import all_ranges
from common.settings.stored_config import flat
from common.transport.leaky_bucket import ACTOR_QUOTA

RunFlags = Annotated[RunConfig, tyro.conf.arg(name="")]
"""A `RunConfig` field whose flags carry no prefix: ``--game``, ``--learning.n-step``."""


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
    first. A replay takes only those settings: name the learner's network."""
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
    asks_for_help = not {*HELP}.isdisjoint(flags)
    try:
        given = [flag for flag in flags if flag not in HELP]
        options = parse(kind, program, given, config=preset)
        found = stored(options)
        defaults = found or options.defaults(preset)
    except InputError:
        if not asks_for_help:
            raise
        defaults = preset
    if asks_for_help or defaults != preset:
        more = own_help(flags)
        flags = going_on_from(flat(defaults), flags)
        options = parse(kind, program, flags, more, config=defaults)
    if ALL_RANGES in arguments:
        drawn = dataclasses.replace(defaults, randomise=all_ranges(options.config.env))
        options = parse(kind, program, flags, config=drawn)
    with naming_flags():
        check_config(options.config)
        check_chosen(defaults, options.config)
    config = options.config.pinned()
    if config != found:  # a stored run goes on, even if a new version of a package declares more
        config = config.in_full()
    return dataclasses.replace(options, config=config)
