"""Configurations as plain data: written as JSON or as flags, read whatever version wrote them, and
compared."""

import dataclasses
import json
import re
import reprlib
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

from common.checked import Invalid, build
from common.errors import InputError

RENAMED = {
    "play.history": "play.frame_stack",
    "play.press": "play.press_latency",
    "camera.delay": "camera.latency",
    "camera.exposure": "randomise.exposure",
    "camera.colour_gain": "randomise.colour",
    "camera.camera_jitter": "randomise.head_pose",
    "camera.screen_jitter": "randomise.screen_distance",
    "randomise.latency": "randomise.actuation_latency",
    "randomise.jitter": "randomise.actuation_jitter",
    "replay.warmup": "replay.learning_starts",
    "learning.train_every": "learning.train_period",
    "learning.target_every": "learning.target_update_period",
    "learning.publish_every": "learning.publish_period",
    "learning.checkpoint_every": "learning.checkpoint_period",
    "exploration.lasting": "exploration.ez_greedy",
}
"""Present names of fields by their former names, which runs and policies on disk may have."""

REMOVED: dict[str, Any] = {
    "play.delay": 0,
    "play.command_latency": 0,
    "play.release": 0,
    "play.release_latency": 0,
    "learning.vector_scale": 1.0,
    "learning.dueling": False,
    "learning.cut_random": False,
    "learning.watkins_cut": False,
    "exploration.per_env": False,
}
"""Fields of former versions that no longer exist, and the value with which they had no effect."""

INSTEAD = dict.fromkeys(("play.delay", "play.command_latency"), "play.actuation_latency")
"""What does the same now as a removed field, in emulator frames instead of agent steps."""

_HASH = re.compile(r"(#sha256=[0-9a-f]{8})[0-9a-f]{56}$")
"""The hash of a file that a setting names (`common.pinned_file`)."""

T = TypeVar("T")


def to_json(config: Any) -> str:
    """Returns a configuration dataclass as readable JSON."""
    return json.dumps(dataclasses.asdict(config), indent=2)


def flat(config: Any) -> dict[str, bool | int | float | str]:
    """Returns the settings by their full names, such as ``learning.n_step``. A value that is not a
    number, a boolean or a text is given as its text."""
    return {
        name: value if isinstance(value, bool | int | float | str) else str(value)
        for name, value in by_full_name(dataclasses.asdict(config))
    }


def by_full_name(table: Mapping[str, Any], group: str = "") -> Iterator[tuple[str, Any]]:
    """Yields the values of a table of tables with their full names."""
    for name, value in table.items():
        if isinstance(value, dict):
            yield from by_full_name(value, f"{group}{name}.")
        else:
            yield group + name, value


def flag_of(setting: str, value: Any) -> list[str]:
    """Returns the flag that gives a ``setting``, such as ``learning.n_step``, its ``value``: in one
    word if the value begins like a flag."""
    group, dot, name = setting.replace("_", "-").rpartition(".")
    if isinstance(value, bool):
        return [f"--{group}{dot}{'' if value else 'no-'}{name}"]
    words = [f"--{group}{dot}{name}", str(value)]
    return ["=".join(words)] if words[1].startswith("-") else words


def from_mapping(kind: type[T], data: Any, where: str = "config", *, fill: bool = False) -> T:
    """Returns a configuration dataclass ``kind``, or one setting of a declared ``kind``, built
    strictly from plain data. Raises InputError if a field is missing, unknown, of the wrong type or
    out of bounds; ``where`` names the place.

    Args:
        fill: use the default of a field that is missing in a group, for files that are older than
            the field. The default of a new field must therefore be the former behaviour.
    """
    try:
        return build(kind, _with_present_fields(data, where) if fill else data, where, fill=fill)
    except Invalid as error:
        raise InputError(f"{error}.") from None


def _with_present_fields(data: Any, where: str) -> Any:
    """Returns ``data`` with renamed fields under their present names, and without removed fields.
    Raises Invalid if a removed field was in use."""
    if not isinstance(data, dict):
        return data
    named = {group: dict(each) if isinstance(each, dict) else each for group, each in data.items()}
    for former, present in RENAMED.items():
        (old_group, old), (group, new) = former.split("."), present.split(".")
        before = named.get(old_group)
        if isinstance(before, dict) and old in before:
            # A group that is newer than the file is made for the fields that move into it.
            fields = named.setdefault(group, {})
            if isinstance(fields, dict) and new not in fields:
                fields[new] = before.pop(old)
    play = named.get("play")
    if isinstance(play, dict) and (rate := play.pop("model_rate", None)) not in (None, 30):
        play.setdefault("robot_settings", f"rate={rate}")  # the latency model declares it now
    for gone, usual in REMOVED.items():
        group, name = gone.split(".")
        fields = named.get(group)
        if isinstance(fields, dict) and (value := fields.pop(name, usual)) != usual:
            raise Invalid(
                f"{where}.{gone} is {reprlib.repr(value)}, and is gone: use the version that had it"
            )
    return named


def differences(old: Any, new: Any) -> list[str]:
    """Returns the settings in which two configurations differ, with both values as words for
    people: of the hash of a file, the first eight digits."""
    before, after = flat(old), flat(new)
    return [
        f"{name} {_shown(value)} → {_shown(after[name])}"
        for name, value in before.items()
        if value != after[name]
    ]


def _shown(value: bool | float | str) -> str:
    return _HASH.sub(r"\1…", str(value)) or "none"
