"""A change of a message raises the number by which processes of two versions refuse each other."""

import dataclasses
import hashlib
import importlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
import pytest
from annotated_types import MaxLen
from numpy.typing import NDArray

from common.checked import Rows
from common.protocol.message import Array, Message, dtype_of
from common.protocol.wire import SCHEMA
from common.settings.config import RunConfig
from tests.paths import ROOT

DECLARED = (10, "4f34d48923ef12af")
"""A schema, and the digest of its messages."""


def test_the_messages_are_those_of_the_schema() -> None:
    found = digest(*messages())
    assert (SCHEMA, found) == DECLARED, (
        "a message has changed: raise SCHEMA in common/protocol/wire.py, and its number in "
        f"CHANGELOG.md, unless no release has {SCHEMA} yet; then set DECLARED to it and {found!r}"
    )


def messages() -> Iterator[type[Message]]:
    """All messages of the product, each in a module that names their base."""
    named = re.compile(r"\bMessage\b")
    for package in ("actors", "common", "learner", "replay"):
        for path in (ROOT / package).rglob("*.py"):
            module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            if named.search(path.read_text()):
                yield from messages_of(importlib.import_module(module))


def messages_of(module: ModuleType) -> Iterator[type[Message]]:
    """The messages that a module declares, whatever else they are."""
    for each in vars(module).values():
        own = isinstance(each, type) and each.__module__ == module.__name__
        if own and issubclass(each, Message) and each is not Message:
            yield each


def digest(*kinds: type) -> str:
    told = sorted(f"{kind.__name__}: {accepted(kind)}" for kind in kinds)
    return hashlib.sha256("\n".join(told).encode()).hexdigest()[:16]


def accepted(hint: Any) -> str:
    """What a receiver accepts: names of fields, types and bounds, but no defaults.

    A run's settings are left out, because whoever joins a run is told if it knows others.
    """
    if hint is RunConfig:
        return "settings"
    if get_origin(hint) is Annotated:
        kind, *marks = get_args(hint)
        array = [f"{dtype_of(kind).str} {vars(mark)}" for mark in marks if isinstance(mark, Array)]
        return "".join(array or [accepted(kind), *map(_bounds, marks)])
    if dataclasses.is_dataclass(hint) or hasattr(hint, "_fields"):
        hints = get_type_hints(hint, include_extras=True)
        fields = [f"{name}: {accepted(each)}" for name, each in hints.items() if name != "LIMITS"]
        ordered = fields if issubclass(hint, tuple) else sorted(fields)
        return f"{ordered}{getattr(hint, 'LIMITS', '')}"
    if get_origin(hint) in (np.ndarray, NDArray):  # NDArray is an alias in NumPy 2.5
        return "array"
    if inner := [accepted(each) for each in get_args(hint)]:
        return f"{get_origin(hint)}{inner}"
    return str(hint)


def _bounds(mark: Any) -> str:
    values = ((each.name, getattr(mark, each.name)) for each in dataclasses.fields(mark))
    return f" {[each for each in values if isinstance(each[1], int | float | str)]}"


class Row(NamedTuple):
    first: int
    second: int


class Swapped(NamedTuple):
    second: int
    first: int


@dataclass(frozen=True)
class Told(Message):
    LIMITS: ClassVar = {"T": (1, 3)}

    rows: Rows[Row]
    values: Annotated[NDArray[np.uint8], Array("T", most=9)]
    kind: Literal["a", "b"]


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("more", int),
        *(("kind", hint) for hint in (str, Literal["a"], Literal["a", "b"] | None)),
        *(("rows", hint) for hint in (Rows[Swapped], Annotated[Rows[Row], MaxLen(2)], Row)),
        ("values", Annotated[NDArray[np.int8], Array("T", most=9)]),
        ("values", Annotated[NDArray[np.uint8], Array("T", 2, most=9)]),
        ("values", Annotated[NDArray[np.uint8], Array("T", most=8)]),
    ],
)
def test_another_name_type_or_bound_is_another_message(name: str, hint: Any) -> None:
    other = dataclasses.make_dataclass("Told", [(name, hint)], bases=(Told,), frozen=True)
    assert digest(other) != digest(Told)


def test_other_limits_are_another_message() -> None:
    class Longer(Told):
        LIMITS: ClassVar = {"T": (1, 4)}

    assert accepted(Longer) != accepted(Told)


def test_a_message_counts_whatever_else_it_is_and_wherever_its_base_is_named() -> None:
    module = ModuleType("module")
    mixed = type("Mixed", (Told, dict), {"__module__": "module"})
    vars(module).update(Mixed=mixed, Told=Told, Message=Message, text="text")
    assert list(messages_of(module)) == [mixed]


def test_every_message_counts() -> None:
    names = {each.__name__ for each in messages()}
    assert {"Ack", "ActorStats", "Chunk", "SharedBatch", "Signature", "SampleRequest"} <= names
