"""Flags of the settings that extensions declare for themselves: how they go on from stored ones,
and their help."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, get_type_hints

from common.command_line.first_flags import read_first
from common.settings.meanings import bounds, docstrings
from common.settings.own_settings import EXTENSIONS, defaults_of, written
from common.settings.stored_config import flag_of

ALL_RANGES = "--randomise.all"
"""Flag that sets the published range of everything that can be drawn for each game."""
HELP = ("-h", "--help")
"""Flags that ask for a program's help."""


def going_on_from(before: Mapping[str, Any], arguments: Sequence[str]) -> list[str]:
    """Returns ``arguments`` whose own settings of extensions go on from those ``before``: what they
    do not name stays, unless they choose another extension or give an empty text.

    Args:
        before: settings by their full names, as `flat` returns them.
    """
    known, rest = _split(arguments)
    for extension in EXTENSIONS:
        if (name := known.get(extension.name)) is not None:
            rest += flag_of(extension.name, name)
        now = extension.going_on(before, known)
        if now != before.get(extension.text, ""):
            rest += flag_of(extension.text, now)
    return rest


def own_help(arguments: Sequence[str]) -> str:
    """Returns what ``--help`` says of flags that stand for others, and of the own settings of the
    extensions that ``arguments`` choose: each with its default, bounds and meaning. Raises
    InputError for an unknown extension."""
    known, rest = _split(arguments)
    if not {*HELP} & {*rest}:
        return ""
    lines = [
        "--config FILE stands for the flags in FILE: TOML, a run's config.json or a policy's card. "
        "Flags beside it go over them.",
        "",
    ]
    for extension in EXTENSIONS:
        if (name := known.get(extension.name)) is None:
            continue
        if (kind := extension.registry.find(name).settings) is None:
            continue
        flag, _ = flag_of(extension.text, "")
        lines += [f"Settings of {name}, each for {flag} 'NAME=VALUE ...':", ""]
        hints, meanings = get_type_hints(kind, include_extras=True), docstrings(kind)
        defaults = defaults_of(kind)
        for field in fields(kind):
            hint, meaning = hints[field.name], meanings.get(field.name, "")
            pair = field.name
            if field.name in defaults:
                pair += f"={written(defaults[field.name])}"
            choices = "true, false" if hint is bool else bounds(hint)
            lines.append(f"  {pair} ({choices}): {meaning}".rstrip(": "))
        lines.append("")
    return "\n".join([*lines, ""])


def _split(arguments: Sequence[str]) -> tuple[dict[str, str], list[str]]:
    """Returns what ``arguments`` say of extensions, by the setting's name, and the others."""
    ways = {name: {flag_of(name, "")[0], f"--{name}"} for each in EXTENSIONS for name in each[:2]}
    ways["play.robot"].add("--robot")
    return read_first(arguments, {name: sorted(flags) for name, flags in ways.items()})
