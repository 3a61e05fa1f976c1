"""The Python in the pages is the package's: its names and the parameters of its functions exist."""

import ast
import inspect
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import ale_robot
from common.settings.conditions import CameraConfig, PlayConfig
from tests.docs.test_pages import PAGES
from tests.paths import ROOT

BLOCK = re.compile(r"^( *)```python\n(.*?)^ *```$", re.DOTALL | re.M)
REPLACED = {"play": PlayConfig, "camera": CameraConfig}
"""By the last name of the first argument, what the pages change by `dataclasses.replace`."""


def blocks(page: Path) -> list[str]:
    """The page's Python that uses the package; other blocks may be parts of a statement."""
    found = (textwrap.dedent(each[2]) for each in BLOCK.finditer(page.read_text("utf-8")))
    return [code for code in found if "import ale_robot" in code]


def wrong_calls(code: str) -> Iterator[str]:
    """Calls of the package, and of ``replace``, whose name or parameters there are not."""
    for node in ast.walk(ast.parse(code)):
        if not isinstance(node, ast.Call):
            continue
        called: Any
        match node.func, node.args:
            case ast.Attribute(ast.Name("ale_robot"), name), _:
                called = getattr(ale_robot, name, None)
            case ast.Name("replace"), [ast.Attribute(attr=group)]:
                called = REPLACED.get(group)
            case _:
                continue
        parameters = inspect.signature(called).parameters if called else {}
        if called is None or not {each.arg for each in node.keywords} <= parameters.keys():
            yield ast.unparse(node)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_calls_name_what_there_is(page: Path) -> None:
    assert [call for code in blocks(page) for call in wrong_calls(code)] == []


def test_there_is_something_to_check() -> None:
    assert sum(code.count("ale_robot.") for page in PAGES for code in blocks(page)) >= 5


@pytest.mark.parametrize(
    "code",
    [
        "ale_robot.RandomiseConfig(latency=4)",
        "x = f(ale_robot.no_such(1))",
        "replace(policy.config.play, latency=4)",
    ],
)
def test_a_wrong_call_is_found(code: str) -> None:
    assert list(wrong_calls(code))
