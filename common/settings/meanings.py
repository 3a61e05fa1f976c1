"""Reads what a dataclass of settings says about its fields: what each may be, and means."""

import ast
import inspect
import textwrap
from itertools import chain
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt

from common.checked import MAX_COUNT


def docstrings(kind: type) -> dict[str, str]:
    """Returns the text below each field of ``kind`` that has one, as one line; nothing for a class
    without source code."""
    try:
        source = inspect.getsource(kind)
    except (OSError, TypeError):
        return {}
    tree = ast.parse(textwrap.dedent(source)).body[0]
    assert isinstance(tree, ast.ClassDef)
    found = {}
    for field, text in zip(tree.body, tree.body[1:], strict=False):
        match field, text:
            case (
                ast.AnnAssign(target=ast.Name(id=name)),
                ast.Expr(value=ast.Constant(value=str(meaning))),
            ):
                found[name] = one_line(meaning)
    return found


def one_line(text: str) -> str:
    """Returns ``text`` without its line breaks."""
    return " ".join(text.split())


def bounds(hint: Any) -> str:
    """Returns what a setting may be, such as "0 to 1" or "uniform, prioritised"."""
    if get_origin(hint) in (Union, UnionType):
        return "; or ".join("none" if each is NoneType else bounds(each) for each in get_args(hint))
    kind, *marks = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    if get_origin(kind) is Literal:
        return ", ".join(map(str, get_args(kind)))
    if kind not in (int, float):
        return {bool: "yes, no", str: "text"}.get(kind, str(kind))
    low = next((_number(mark.ge) for mark in marks if isinstance(mark, Ge)), "")
    low = next((f"above {_number(mark.gt)}" for mark in marks if isinstance(mark, Gt)), low)
    highs = (_number(mark.le) for mark in marks if isinstance(mark, Le) and mark.le != MAX_COUNT)
    below = (f"below {mark.lt}" for mark in marks if isinstance(mark, Lt) and kind is float)
    high = next(chain(highs, below), "")
    if low and high:
        span = f"{low} to {high}"
    elif low:
        span = low if low.startswith("above") else f"{low} or more"
    else:
        span = f"at most {high}" if high else "number"
    return span if kind is float else "integer" if span == "number" else f"integer, {span}"


def _number(bound: Any) -> str:
    return f"{bound:,}".removesuffix(".0")
