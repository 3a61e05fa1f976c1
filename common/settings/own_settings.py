"""Settings that an environment, robot, algorithm or sampler of another package declares for itself.

They are a frozen dataclass, with bounds and defaults beside its fields, as in
`common.settings.conditions`. A run's configuration holds them as one text, such as
``kappa=0.5 depth=3``, so that it can be stored and sent without the package.
"""

import json
import shlex
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import MISSING, asdict, fields
from typing import Any, Literal, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

from common.errors import InputError, choice
from common.registry import ALGORITHMS, ENVIRONMENTS, ROBOTS, SAMPLERS, Entry, Registry
from common.settings.stored_config import from_mapping

T = TypeVar("T")


class Extension(NamedTuple):
    """A part of a run that another package may add."""

    name: str
    """Setting that chooses it, such as ``learning.algorithm``."""
    text: str
    """Setting that holds its own settings."""
    registry: Registry[Any]

    def going_on(self, before: Mapping[str, Any], given: Mapping[str, str | None]) -> str:
        """Returns its own settings, which go on from those ``before``: what is not ``given`` stays,
        unless another extension or an empty text is. Both are settings by their full names."""
        now, former = given.get(self.name), str(before.get(self.name))
        same = now is None or self.registry.called(now) == self.registry.called(former)
        kept = before.get(self.text, "") if same else ""
        return merged(kept, given.get(self.text), self.text)


ENVIRONMENT = Extension("env", "play.env_settings", ENVIRONMENTS)
ROBOT = Extension("play.robot", "play.robot_settings", ROBOTS)
ALGORITHM = Extension("learning.algorithm", "learning.algorithm_settings", ALGORITHMS)
SAMPLER = Extension("replay.sampler", "replay.sampler_settings", SAMPLERS)
EXTENSIONS = (ENVIRONMENT, ROBOT, ALGORITHM, SAMPLER)


def own_settings(kind: type[T], text: str, where: str = "") -> T:
    """Returns the ``kind`` that ``text`` describes; what it does not name has its default. Raises
    InputError if a setting is unknown, given twice, not of its type, or out of bounds; if one
    without a default is not named; or if the ``__post_init__`` of ``kind`` refuses them.

    Args:
        text: pairs of name and value, with ``=`` between them, separated by blanks. A value with
            blanks is quoted, as in a shell.
        where: names the text in errors; by default it is the name of ``kind``.
    """
    where = where or kind.__name__
    hints = get_type_hints(kind)
    known = sorted(field.name for field in fields(kind))  # type: ignore[arg-type]
    given: dict[str, Any] = {}
    for pair in _pairs(text, where):
        name, equals, value = pair.partition("=")
        if not equals:
            raise InputError(f"{where} has {pair!r}: write name=value.")
        if name not in known:
            raise InputError(f"{where} has no {name!r}: {choice(name, known)}")
        if name in given:
            raise InputError(f"{where} has {name} twice: omit one of them.")
        given[name] = _value(hints[name], value)
    try:
        return from_mapping(kind, defaults_of(kind) | given, where)
    except (TypeError, ArithmeticError) as error:  # of `__post_init__`, which another package wrote
        raise InputError(f"{where} is {text!r}: {error}.") from None


def merged(kept: str, given: str | None, where: str) -> str:
    """Returns the text of ``kept`` settings with those that were ``given`` in their place: None
    leaves all as they are, and an empty text drops all."""
    if not given:
        return kept if given is None else ""
    named = {pair.partition("=")[0] for pair in _pairs(given, where)}
    others = (pair for pair in _pairs(kept, where) if pair.partition("=")[0] not in named)
    return f"{shlex.join(others)} {given}".strip()


def check_own_settings(entry: Entry, text: str, where: str) -> None:
    """Checks the settings of ``entry`` itself, as `own_settings` does. Raises InputError if there
    are any, but the entry declares none."""
    if entry.settings is not None:
        own_settings(entry.settings, text, where)
    elif text:
        raise InputError(
            f"{where} is {text!r}, but {entry.name} has no settings of its own: leave it empty."
        )


def in_full(entry: Entry, text: str) -> str:
    """Returns ``text`` with every setting that ``entry`` declares, so that the defaults of another
    version of its package do not change the run."""
    if entry.settings is None:
        return text
    values: dict[str, Any] = asdict(own_settings(entry.settings, text))
    return " ".join(f"{name}={written(value)}" for name, value in values.items())


def written(value: Any) -> str:
    """Returns a setting's value as `own_settings` reads it."""
    return shlex.quote(
        value if isinstance(value, str) else json.dumps(value, separators=(",", ":"))
    )


def _pairs(text: str, where: str) -> list[str]:
    try:
        return shlex.split(text)
    except ValueError:
        raise InputError(
            f"{where} is {text!r}: a quotation mark, or what follows a backslash, is missing."
        ) from None


def defaults_of(kind: Any) -> dict[str, Any]:
    """Returns the defaults of the fields that have one."""
    found: dict[str, Any] = {}
    for field in fields(kind):
        if field.default is not MISSING:
            found[field.name] = field.default
        elif field.default_factory is not MISSING:
            found[field.name] = field.default_factory()
    return found


def _value(hint: Any, text: str) -> Any:
    """Returns the value that ``text`` stands for, for the declaration to check."""
    if hint is str or (get_origin(hint) is Literal and isinstance(get_args(hint)[0], str)):
        return text
    # Python writes numbers in more ways, such as .5 and inf, and so does every other flag.
    for read in (json.loads, float) if hint is float else (json.loads,):
        with suppress(ValueError, RecursionError):
            return read(text)
    return text
