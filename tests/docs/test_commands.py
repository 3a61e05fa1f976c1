"""Every command that a page tells is one that its program takes as it is written."""

import multiprocessing
import os
import re
import runpy
import shlex
import sys
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from multiprocessing.connection import Connection
from pathlib import Path
from string import Template
from typing import Any
from unittest.mock import patch

import tyro

from common.command_line import parser
from tests.docs.test_pages import PAGES as ALL_PAGES
from tests.forked import FORKS
from tests.paths import ROOT

PROGRAM = re.compile(r"(?:\S+=\S+ )*(?:\S*python(?:3\.11)? -m|ale-robot) (?P<arguments>\S.*)")
BLOCK = re.compile(r"^```\w*\n(.*?)^```$|((?:^ {4}[^\n]*\n)+)", re.DOTALL | re.M)
INLINE = re.compile(r"`([^`]+)`")

# What stands in these was right when it was written.
PAGES = [page for page in ALL_PAGES if page.name not in ("LOG.md", "CHANGELOG.md")]


class Taken(BaseException):
    """The program has taken its command line."""


def commands(page: str) -> Iterator[list[str]]:
    """Yields the arguments of each ``python -m`` in ``page``, the module's name among them.

    What stands within a sentence may only name a program, or a flag of it: it counts from four
    arguments on.
    """
    given: dict[str, str] = {}
    blocks = "".join(block[1] or block[2] for block in BLOCK.finditer(page))
    lines = re.sub(r"\\\n\s*", "", blocks).splitlines()
    within = [text.replace("\n", " ") for text in INLINE.findall(BLOCK.sub("", page))]
    for line, least in [*((line, 0) for line in lines), *((text, 3) for text in within)]:
        told = Template(line.strip()).safe_substitute(given)
        if variable := re.fullmatch(r"([A-Z]+)=(\S+|\".*\")", told):
            given[variable[1]] = variable[2].strip('"')
        if not (found := PROGRAM.fullmatch(told)):
            continue
        arguments = shlex.split(found["arguments"], comments=True)
        if len(arguments) > least and "…" not in told:
            yield [*(["ale_robot"] if "ale-robot " in told else []), *arguments]


def refusal(program: str, *arguments: str) -> str:
    """Returns what a program says to its command line before it refuses it; nothing if it takes
    it."""
    sys.argv = [program, *arguments]
    with redirect_stderr(StringIO()) as said, redirect_stdout(StringIO()):
        try:
            runpy.run_module(program, run_name="__main__", alter_sys=True)
        except Taken:
            return ""
        except SystemExit as left:
            return said.getvalue() if left.code else ""
    return "it ran"


def refused(answer: Connection) -> None:
    """Sends what is said to each command that is refused."""
    taken = tyro.cli

    def cli(*args: Any, **kwargs: Any) -> None:
        taken(*args, **kwargs)
        raise Taken

    os.chdir(ROOT)
    told = {tuple(each): page.name for page in PAGES for each in commands(page.read_text("utf-8"))}
    networks = patch.object(parser, "find_weights", Path)  # that a reader will have
    with patch.object(tyro, "cli", cli), networks:
        said = {f"{page}: {shlex.join(each)}": refusal(*each) for each, page in told.items()}
    answer.send((len(said), {command: why for command, why in said.items() if why}))


def test_programs_take_the_commands_of_each_page() -> None:
    ours, theirs = multiprocessing.Pipe(duplex=False)
    process = FORKS.Process(target=refused, args=(theirs,))
    process.start()
    theirs.close()
    count, found = ours.recv()
    process.join()
    assert found == {}
    assert count > 90
