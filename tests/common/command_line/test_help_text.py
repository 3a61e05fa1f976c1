"""What `help_text` replaces in tyro; `test_parser.py` has what users see."""

import importlib.util
import sys
from types import ModuleType

import pytest
import tyro

from common.command_line import help_text


def fresh(name: str) -> ModuleType:
    """A copy of the module ``name`` that nobody has changed."""
    spec = importlib.util.find_spec(name)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_tyro_still_keeps_the_line_breaks_of_indented_lines() -> None:
    """Once it joins them, nothing of tyro needs to be replaced."""
    own = fresh("tyro._strings").remove_single_line_breaks
    assert own("One paragraph\n    of two lines.") == "One paragraph\n    of two lines."
    assert tyro._strings.remove_single_line_breaks is help_text._joined_lines


def test_a_tyro_without_that_function_does_no_harm(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(tyro, "_strings")
    monkeypatch.setitem(sys.modules, "tyro._strings", None)
    assert fresh("common.command_line.help_text").wrapped("One paragraph\nof two lines.") == (
        "One paragraph of two lines."
    )


def test_paragraphs_fit_the_terminal_and_indented_lines_stay(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", "20")
    table = "    2  an input is refused\n    3  a check is red"
    assert help_text.wrapped(f"A paragraph\nof two lines that are short.\n\n{table}") == (
        f"A paragraph of two\nlines that are\nshort.\n\n{table}"
    )
