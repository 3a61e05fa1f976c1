"""``--config FILE``: settings in a file, as flags."""

import dataclasses
import json
import tomllib
from collections.abc import Container, Sequence
from itertools import chain
from pathlib import Path

from common.command_line.first_flags import read_first
from common.command_line.own_flags import going_on_from
from common.errors import InputError, cannot_read
from common.regular_file import read_file
from common.settings.config import RunConfig
from common.settings.stored_config import by_full_name, flag_of, from_mapping


def with_file(arguments: Sequence[str], used: Container[str] | None = None) -> list[str]:
    """Returns ``arguments`` with ``--config FILE`` replaced by the flags that the file stands for.

    They come first, so flags on the command line override them. The file is TOML whose tables are
    groups of flags, the ``config.json`` of a run, or the card of a policy. Raises InputError if it
    cannot be read.

    Args:
        used: fields of a `RunConfig` that the program has flags for; None for all. Of the settings
            of a run or a card, the others are passed over.
    """
    known, rest = read_first(arguments, {"config": ["--config"]})
    if "--config" in rest:
        raise InputError("--config names a file of settings: add it, as --config FILE.")
    if not known:
        return rest
    file = Path(known["config"])
    try:
        text = read_file(file).decode()
        if file.suffix == ".json":
            told = json.loads(text)
            stored = told.get("config", told) if isinstance(told, dict) else told
            if isinstance(stored, dict) and stored.keys().isdisjoint(vars(RunConfig())):
                raise ValueError("it holds no settings of a run")
            told = dataclasses.asdict(from_mapping(RunConfig, stored, str(file), fill=True))
            told = {name: value for name, value in told.items() if used is None or name in used}
        else:
            told = tomllib.loads(text)
        given = {
            name.replace("-", "_"): value for name, value in by_full_name(told) if value is not None
        }
        flags = list(chain.from_iterable(flag_of(*each) for each in given.items()))
    except (OSError, ValueError, RecursionError) as error:
        raise cannot_read(file, error) from None
    if "config" in told:
        raise InputError(f"{file} names another file of settings: remove config from it.")
    if any("\0" in flag for flag in flags):
        raise InputError(f"--config {file} holds a NUL character: remove it.")
    return [*flags, *going_on_from(given, rest)]
