"""`python -m docs.settings`: writes docs/settings.md, every setting of a run with its presets.

Names, bounds and meanings are those of the dataclasses from which the flags are generated, so the
page cannot say anything else than the program does.
"""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, get_type_hints

from common.settings.config import RunConfig
from common.settings.meanings import bounds, docstrings, one_line
from common.settings.presets import PRESETS

PAGE = Path(__file__).with_name("settings.md")
_HEAD = """\
# Settings

Written by `python -m docs.settings` from `config.py`, `conditions.py` and `ranges.py` in
`common/settings`; a test compares them. Each setting is a flag of `ale-robot train`, and a line of
a `--config` file. The columns on the right are the values of `--preset paper`, `fast`, `robot` and
`frugal`; [presets.py](../common/settings/presets.py) gives the reason for each. Flags that belong
to a process and not to the run are with
[several machines](../deploy/README.md#the-learners-flags-of-operation).
"""
_COLUMNS = f"| flag | values | meaning | {' | '.join(PRESETS)} |"
_RULE = f"| --- | --- | --- |{' --- |' * len(PRESETS)}"


def page() -> str:
    """Returns the whole page in Markdown."""
    return "\n".join([_HEAD, *_section(RunConfig, "", "The run")])


def _section(kind: type, group: str, title: str) -> Iterator[str]:
    """Yields the table of ``kind``, and then those of the groups in it."""
    hints, meanings = get_type_hints(kind, include_extras=True), docstrings(kind)
    yield from (f"## {title}", "")
    if group:
        yield from (one_line(kind.__doc__ or ""), "")
    yield from (_COLUMNS, _RULE)
    inner: list[tuple[str, type]] = []
    for field in fields(kind):
        hint = hints[field.name]
        if is_dataclass(hint):
            inner.append((field.name, hint))  # type: ignore[arg-type]
        else:
            yield _row(group, field.name, hint, meanings[field.name])
    yield ""
    for name, hint in inner:
        yield from _section(hint, name, name.capitalize())


def _row(group: str, name: str, hint: Any, meaning: str) -> str:
    flag = f"--{group}{'.' if group else ''}{name}".replace("_", "-")
    presets = [getattr(preset, group) if group else preset for preset in PRESETS.values()]
    values = [_value(getattr(preset, name)) for preset in presets]
    return row(f"`{flag}`", bounds(hint), meaning, *values)


def row(*cells: str) -> str:
    """Returns a line of a table in Markdown."""
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def _value(value: object) -> str:
    match value:
        case bool():
            return "yes" if value else "no"
        case int() | float():
            return f"{value:,}".removesuffix(".0")
        case _:
            return str(value)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(f"wrote {PAGE}")
