"""The flags of every command that plays: the game and its conditions, and the network that plays.

What no flag gives is as in the training of the network, or else as in the preset of the
environment.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TypeVar

import tyro

from common.command_line.config_file import with_file
from common.command_line.first_flags import read_first
from common.command_line.flag_errors import naming_flags
from common.command_line.own_flags import ALL_RANGES, HELP, going_on_from, own_help
from common.command_line.parser import parse
from common.errors import InputError
from common.registry import ENVIRONMENTS
from common.run.origin import origin_of
from common.run.rules import check_chosen, check_play
from common.settings.conditions import CameraConfig, PlayConfig
from common.settings.config import RunConfig, Seed
from common.settings.fit import check_fit
from common.settings.own_settings import defaults_of
from common.settings.presets import PRESETS
from common.settings.ranges import all_ranges
from common.settings.stored_config import differences, flat


def playing_settings(network: Path | None, env: str = RunConfig.env) -> RunConfig:
    """Returns the settings under which ``network`` plays unless flags say otherwise: those of its
    run. Without a run or a card, they are those of the environment ``env``, with all 18 actions.
    Raises InputError if the settings in the run or the card cannot be read."""
    trained = None if network is None else origin_of(network)
    if trained is not None:
        return trained.for_play
    config = PRESETS[ENVIRONMENTS.find(env).preset]
    return replace(config, play=replace(config.play, minimal_actions=False))


@dataclass(frozen=True)
class Played:
    """The flags of every command that plays: the game and its conditions, and who plays it."""

    env: str = RunConfig.env
    """Environment: 'robot', 'ale', or a registered one."""
    game: str = RunConfig.game
    """Game: any that ale-py bundles."""
    seed: Seed = RunConfig.seed
    """Seed of the games and the random actions; by default that of the network's training."""
    play: PlayConfig = field(default_factory=PlayConfig)
    camera: CameraConfig = field(default_factory=CameraConfig)

    @property
    def network(self) -> Path | None:
        """The network that plays; None for random actions or a person."""
        return None

    @classmethod
    def usual(cls, config: RunConfig) -> RunConfig:
        """Returns the defaults of this command's flags, for a network whose settings are
        ``config``."""
        return config

    def check(self) -> None:
        """Refuses flags that cannot work, before PyTorch is loaded, which takes seconds. Raises
        InputError that names the flag."""

    def config(self) -> RunConfig:
        """Returns the settings: those of the run of the network, changed by these flags.

        Raises InputError if the flags cannot work, or if the network does not fit them.
        """
        usual = playing_settings(self.network, self.env)
        given = {name: getattr(self, name) for name in _config_fields(type(self))}
        config = replace(usual, **given)
        with naming_flags():
            check_play(config)
            check_chosen(usual, config)
        if self.network is not None:
            check_fit(self.network, origin_of(self.network), config)
        return config.pinned()

    def changes(self) -> str:
        """Returns in which settings the network plays otherwise than it was trained, as words for
        people; an empty text if in none."""
        if self.network is None or (trained := origin_of(self.network)) is None:
            return ""
        usual = replace(trained.for_play, seed=self.seed)
        return ", ".join(differences(usual, self.config()))

    def tell_changes(self) -> None:
        """Prints `changes`, if there are any."""
        if changes := self.changes():
            print(f"other than trained: {changes}")


P = TypeVar("P", bound=Played)


def _config_fields(kind: type[Played]) -> list[str]:
    """Returns the fields of a `RunConfig` that a command has flags for."""
    return [each.name for each in fields(kind) if each.name in vars(RunConfig())]


def parse_played(kind: type[P], program: str, arguments: Sequence[str]) -> P:
    """Parses as `common.command_line.parser.parse` does. What no flag gives is as in the run of
    the network, or else as in the preset of the environment; ``--help`` shows these values.

    If the command can draw conditions, `ALL_RANGES` sets the default of every range.
    """
    arguments = with_file(arguments, _config_fields(kind))
    drawn = "randomise" in _config_fields(kind) and ALL_RANGES in arguments
    if drawn:
        arguments = [argument for argument in arguments if argument != ALL_RANGES]
    known, _ = read_first(arguments, {"env": ["--env"]})
    usual = playing_settings(None, known.get("env", RunConfig.env))
    flags = [argument for argument in arguments if argument not in HELP]
    try:
        command = _parse(kind, program, flags, usual)
        trained = playing_settings(command.network, command.env)
    except InputError:
        if flags == arguments:
            raise
        trained = usual  # its help is asked for, without a network
    if drawn:
        trained = replace(trained, randomise=all_ranges(known.get("env", trained.env)))
    if trained == usual and flags == arguments:
        return command
    return _parse(kind, program, going_on_from(flat(trained), arguments), trained)


def _parse(kind: type[P], program: str, arguments: Sequence[str], config: RunConfig) -> P:
    usually, usual = defaults_of(kind), kind.usual(config)
    needed = {each.name: tyro.MISSING for each in fields(kind) if each.name not in usually}
    defaults = {name: getattr(usual, name) for name in _config_fields(kind)}
    return parse(kind, program, arguments, own_help(arguments), **needed, **defaults)
