"""`python -m benchmarks.figures.screens`: draws docs/screen.png and docs/web.png.

It starts a run for them, and Chromium draws both: the web page, and the terminal's last screen.
"""

import contextlib
import fcntl
import os
import pty
import re
import shutil
import struct
import subprocess
import sys
import termios
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.terminal_theme import SVG_EXPORT_THEME
from rich.text import Text

from benchmarks.child import free_endpoint, run_program, scratch
from benchmarks.quoted_flags import quoted_flags
from common.command_line.parser import parse
from common.errors import InputError
from common.process.extras import extra_for

COLUMNS, ROWS = 150, 43
_CHROMIUM_FLAGS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking")
_RUN = (
    *("--env", "robot", "--initial", "robot_pong", "--play.vector", "--actors", "1"),
    *("--exploration.start", "0.02", "--exploration.end", "0.01"),
    *("--replay.capacity", "20000", "--replay.learning-starts", "1000"),
    *("--protocol.epoch-steps", "1000", "--protocol.test-steps", "500"),
    *("--protocol.held-out-states", "256"),
)
"""Flags for a network that already plays, and for epochs of seconds."""
_ERASED = re.compile(r"\r?\x1b\[2K(?:\x1b\[1A\x1b\[2K)+")
"""What Rich's live display writes before it draws again."""
_PAGE = """<style>
  body {{ margin: 0; }}
  pre {{ margin: 0; width: max-content; font: 15.5px/18px "DejaVu Sans Mono", monospace;
        letter-spacing: calc(9px - 1ch); color: {foreground}; background: {background}; }}
</style><pre>{code}</pre>"""
"""Page for the terminal's screen. Its cells have whole pixels, because others leave seams."""


@dataclass(frozen=True)
class Screens:
    """Start a run, and draw its terminal screen and its web page."""

    minutes: float = 5.0
    """Minutes of the run before it is drawn."""
    folder: Path = Path("docs")
    """Folder for the pictures."""
    learner: str = ""
    """More flags for `python -m learner`; with --resume among them, it gets no others."""


def draw(options: Screens) -> None:
    """Draws both pictures.

    Raises:
        InputError: there is no Chromium, or the run does not begin.
    """
    with extra_for("benchmarks.figures.screens", "dev"):
        from playwright.sync_api import sync_playwright
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        raise InputError("there is no Chromium to draw with: run make browser first.")
    given = quoted_flags(options.learner, "--learner")
    with scratch() as runs:
        web = free_endpoint().removeprefix("tcp/")
        own = () if "--resume" in given else ("--run", "pong", "--runs", str(runs), *_RUN)
        flags = ["--local", "--web", web, "--listen", free_endpoint(), *own, *given]
        with (
            _run_in_terminal(flags) as terminal,
            sync_playwright() as driver,
            driver.chromium.launch(executable_path=chromium, args=_CHROMIUM_FLAGS) as browser,
        ):
            terminal.wait(options.minutes * 60)
            window = browser.new_context(viewport={"width": 1_280, "height": 800}, bypass_csp=True)
            page = window.new_page()
            page.goto(f"http://{web}/")
            # The page's security policy would forbid the waiting function, so it is bypassed.
            page.wait_for_function("document.querySelector('#picture').naturalWidth > 0")
            page.wait_for_timeout(3_000)
            page.screenshot(path=options.folder / "web.png")
            _draw_terminal(browser, terminal.screen(), options.folder / "screen.png")
    for name in ("screen.png", "web.png"):
        print(f"wrote {options.folder / name}")


class _Terminal:
    """The output of a program to its terminal."""

    def __init__(self, far: int, process: "subprocess.Popen[bytes]") -> None:
        self._far = far
        self._process = process
        self._written = b""
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        with contextlib.suppress(OSError):  # the program left
            while part := os.read(self._far, 65_536):
                self._written = (self._written + part)[-4_000_000:]

    def wait(self, seconds: float) -> None:
        """Waits for ``seconds``; raises InputError if the program ends before."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)
            told = Text.from_ansi(self._written.decode(errors="replace")).plain
            raise InputError(f"the run ended before it was drawn: {told[-500:]}")

    def screen(self) -> str:
        """Returns the last complete screen."""
        return last_screen(self._written.decode(errors="replace"))


def last_screen(written: str) -> str:
    """Returns the last complete screen of Rich's live display, with its colours.

    A screen is complete when the next one begins.

    Raises:
        InputError: no screen is complete yet.
    """
    *before, _ = _ERASED.split(written)
    if len(before) < 2:
        raise InputError("the run has not drawn its screen yet: give it more --minutes.")
    return before[-1].replace("\r\n", "\n")  # as a terminal's driver ends lines


@contextlib.contextmanager
def _run_in_terminal(flags: list[str]) -> Iterator[_Terminal]:
    far, near = pty.openpty()
    fcntl.ioctl(near, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
    environment = {**os.environ, "TERM": "xterm-256color", "COLORTERM": "truecolor"}
    process = subprocess.Popen(
        [sys.executable, "-m", "learner", *flags],
        stdin=near,
        stdout=near,
        stderr=near,
        env=environment,
        start_new_session=True,
    )
    os.close(near)
    try:
        yield _Terminal(far, process)
    finally:
        process.terminate()
        process.wait()
        os.close(far)


def _draw_terminal(browser: Any, screen: str, path: Path) -> None:
    with open(os.devnull, "w") as nowhere:
        console = Console(record=True, width=COLUMNS, file=nowhere, force_terminal=True)
        console.print(Text.from_ansi(screen), no_wrap=True, crop=True)
        html = console.export_html(theme=SVG_EXPORT_THEME, code_format=_PAGE, inline_styles=True)
    page = browser.new_page(viewport={"width": 2_000, "height": 1_000})
    page.set_content(html)
    page.locator("pre").screenshot(path=path)


if __name__ == "__main__":
    run_program(lambda: draw(parse(Screens, "benchmarks.figures.screens", sys.argv[1:])))
