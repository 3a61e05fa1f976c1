"""The texts of ``--help``: the lines of a paragraph are joined, and wrapped as the terminal needs.

tyro keeps the line breaks of a field's docstring, because its lines are indented, and up to 1.0.17
it offers no other way than to replace its function, as this module does when it is imported.
"""

import inspect
import re
import shutil
import textwrap
from contextlib import suppress


class _Wrapped(str):
    """A text whose lines are as they should be."""


def _joined_lines(helptext: str) -> str:
    """Returns each paragraph of ``helptext`` as one line, for tyro to wrap. An indented line, as of
    a table, stays a line."""
    if isinstance(helptext, _Wrapped):
        return helptext
    return re.sub(r"(?<!\n)\n(?![\n ])", " ", inspect.cleandoc(helptext))


with suppress(ImportError):  # without it, a later tyro only breaks lines where it should not
    from tyro import _strings

    _strings.remove_single_line_breaks = _joined_lines


def wrapped(text: str) -> str:
    """Returns a program's description, which tyro does not wrap, in lines that fit the terminal."""
    columns = shutil.get_terminal_size().columns
    lines = _joined_lines(text).splitlines()
    return _Wrapped(
        "\n".join(line if line[:1] == " " else textwrap.fill(line, columns) for line in lines)
    )
