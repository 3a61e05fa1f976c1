"""Errors about flags, as sentences for people: tyro's own, and those about settings."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import groupby

from common.errors import InputError
from common.settings.config import RunConfig
from common.settings.stored_config import flag_of, flat


def as_sentence(box: str, all_flags: str) -> str:
    """Returns tyro's error, which it prints in a box, as one sentence, with the command that prints
    all flags."""
    box = re.sub(r"\x1b\[[0-9;]*m", "", box)  # in a terminal tyro colours it
    # Without UTF-8 the box has no border, and its rules are made of "-".
    _, *lines = (line.strip("│╭╮╰╯─ ") for line in box.strip().splitlines())
    told, *hints = (list(part) for rule, part in groupby(lines, _is_rule) if not rule)
    first = " ".join(told)
    if "Unrecognized" not in box:
        return f"{_plainly(first)} `{all_flags}` explains the flags."
    unknown = first.removeprefix("Unrecognized options: ").partition(",")[0]
    # If several are unknown, each has hints of its own.
    headings = ("Perhaps you meant:", f"Arguments similar to {unknown}:")
    of_first = (line for heading, *lines in hints if heading in headings for line in lines)
    alike = [line.split()[0].strip(",") for line in of_first if line.startswith("--")]
    # Of several flags that contain the given name, tyro does not prefer the shortest.
    name = unknown.lstrip("-").rpartition(".")[2]
    alike = sorted((each for each in alike if name in each), key=len) or alike
    hint = f"did you mean {alike[0]}?" if alike else f"`{all_flags}` lists the flags."
    if not unknown.startswith("-"):
        return f"{unknown} lacks a flag before it, or is one too many: {hint}"
    return f"there is no flag {unknown}: {hint}"


@contextmanager
def naming_flags() -> Iterator[None]:
    """Raises an InputError of the block with the flags of the settings that it names: they may come
    from files and messages, too, and are called ``learning.n_step`` there."""
    try:
        yield
    except InputError as error:
        told = re.sub(_SETTING, lambda found: flag_of(found[0], value="")[0], str(error))
        raise InputError(told, error.exit_code) from None


_NAMES = sorted(flat(RunConfig()), key=len, reverse=True)
_IN_GROUPS = "|".join(re.escape(name) for name in _NAMES if "." in name)
_FIRST = "|".join(name for name in _NAMES if "." not in name)
_SETTING = rf"(?<![\w./-])(?:{_IN_GROUPS})(?!\w|\.\w)|^(?:{_FIRST})(?= is )"
"""A setting: in a group, with its group, or at the beginning of a sentence."""
_WITH_COMMAS = r"'(\d+(?:,\d{3})+)'"
_SAID = {
    rf"Error parsing (\S+): invalid literal for int\(\) with base 10: {_WITH_COMMAS}": (
        r"\1 is '\2': write it without commas;"
    ),
    r"Error parsing (\S+): invalid literal for int\(\) with base 10: (.*)": (
        r"\1 is \2: give a whole number;"
    ),
    r"Error parsing (\S+): could not convert string to float: (.*)": r"\1 is \2: give a number;",
    rf"(?:Error parsing )?(\S+): no type matching \S+\|INT could be .* from \[{_WITH_COMMAS}\].*": (
        r"\1 is '\2': write it without commas;"
    ),
    r"(?:Error parsing )?(\S+): no type matching \S+\|INT could be .* from \['(.*)'\].*": (
        r"\1 is '\2': give a whole number;"
    ),
    r"(?:Error parsing )?(\S+): no type matching \S+\|FLOAT could be .* from \['(.*)'\].*": (
        r"\1 is '\2': give a number;"
    ),
    r"[Ii]nvalid choice (.*) for argument '(\S+)'\. Expected one of \((.*)\)\.": (
        r"\2 is \1: choose one of \3;"
    ),
    r"Missing value for argument '(\S+)'.*": r"\1 needs a value:",
    r"Missing from .*?: \{(.*?)\} (.*?)\.? \(required\).*": r"name one of \1 (\2):",
    r"Missing from .*?: STR (.*?)\.? \(required\).*": r"a name is missing (\1):",
    # If several are missing, the first is named.
    r"Missing from .*?: ((?:(?:-\S+|STR,|PATH,) )*)(STR|PATH|FILE) (.*?)\.? \(required\).*": (
        r"\1\2 is missing (\3):"
    ),
}
"""Patterns of tyro's messages, and what people read instead."""


def _plainly(said: str) -> str:
    """Returns the beginning of a sentence that goes on with a command."""
    said = re.sub(r"\{.*?\}", lambda names: names[0].replace(",", ", "), said)
    said = re.sub(r"(?<=\()'None', |, 'None'(?=[,)])", "", said)  # as without the flag
    for pattern, plainly in _SAID.items():
        if found := re.fullmatch(pattern, said):
            return found.expand(plainly)
    return f"{said.removeprefix('Error parsing ').rstrip('.')}:"


def _is_rule(line: str) -> bool:
    return not line.strip("-")
