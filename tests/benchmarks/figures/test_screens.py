"""Draws the terminal screen that a program has written."""

import io

import pytest
from rich.console import Console
from rich.live import Live
from rich.text import Text

from benchmarks.figures.screens import last_screen
from common.errors import InputError


def drawn(*screens: str) -> str:
    """What the live display writes for one screen after the other."""
    stream = io.StringIO()
    console = Console(
        file=stream, force_terminal=True, width=40, height=10, color_system="truecolor"
    )
    with Live(console=console, auto_refresh=False) as live:
        for screen in screens:
            live.update(Text.from_markup(screen), refresh=True)
        return stream.getvalue().replace("\n", "\r\n")


def test_the_last_screen_that_was_drawn_whole_is_taken() -> None:
    written = drawn("a\nb", "[red]c[/]\n█ d", "e\nf\ng")
    assert Text.from_ansi(last_screen(written)).plain.split("\n")[:2] == ["c", "█ d"]
    assert "\x1b[31mc" in last_screen(written)


def test_without_one_there_is_nothing_to_draw() -> None:
    with pytest.raises(InputError, match="give it more --minutes"):
        last_screen(drawn("a\nb"))
