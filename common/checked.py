"""Checks all data that comes from outside: messages, configurations, journals.

A type declares its fields with their bounds (``Annotated[int, Ge(0), Lt(2**63)]``). `build` makes
an instance of it from plain data, or says in one sentence which field is wrong. It is strict: no
field may be missing or unknown, no number may be NaN or infinite, and texts are short. The only
conversion is from a whole number to a float.
"""

import dataclasses
import reprlib
from functools import cache
from typing import Annotated, Any, NotRequired, TypeVar, get_type_hints

from annotated_types import Ge, Le
from pydantic import (
    AfterValidator,
    AllowInfNan,
    ConfigDict,
    GetPydanticSchema,
    Strict,
    StringConstraints,
    TypeAdapter,
)
from pydantic import ValidationError as _Refusal
from pydantic_core import core_schema
from typing_extensions import TypedDict

MAX_TEXT = 200
"""Maximum number of characters of a text."""
MAX_LONG_TEXT = 2_000
MAX_COUNT = 2**63 - 1
MAX_SIZE = 1e9
"""Bound of rewards, scores and vectors: sums and squares of such numbers stay finite."""

_STRICT = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, str_max_length=MAX_TEXT)


Count = Annotated[int, Ge(0), Le(MAX_COUNT)]
FromOne = Annotated[int, Ge(1), Le(MAX_COUNT)]
Amount = Annotated[float, Ge(0)]
Fraction = Annotated[float, Ge(0), Le(1)]
Patience = Annotated[float, Ge(0), AllowInfNan(True)]
"""Seconds; inf to wait for ever."""
LongText = Annotated[str, StringConstraints(max_length=MAX_LONG_TEXT)]
"""A text that may be longer than others."""
MAX_NAME = 64
"""Longest name of a run or a process, letters."""
NAME = rf"^[A-Za-z0-9][A-Za-z0-9._-]{{0,{MAX_NAME - 1}}}$"
Name = Annotated[str, StringConstraints(pattern=NAME)]
"""Name of a run or a process; it becomes part of key expressions and paths."""
Score = Annotated[float, Ge(-MAX_SIZE), Le(MAX_SIZE)]

T = TypeVar("T")
_ROW = GetPydanticSchema(
    lambda source, handler: core_schema.chain_schema(
        [core_schema.is_instance_schema((list, tuple), cls_repr="row"), handler(source)]
    )
)
Rows = Annotated[tuple[Annotated[T, _ROW], ...], Strict(False)]
"""Named tuples, each written as a list of its values without their names."""
Values = Annotated[tuple[T, ...], Strict(False)]
"""Any number of values, written as a list."""


_TypedDict: Any = TypedDict  # type checkers accept it with constants only


class Invalid(ValueError):
    """The data does not fit its declaration; the text names the field and says what is wrong."""


def build(
    kind: type[T], data: Any, where: str = "", *, fill: bool = False, context: Any = None
) -> T:
    """Returns a ``kind`` made from plain data: dataclasses from tables, named tuples from lists.
    Raises Invalid if a field is missing, unknown, of the wrong type, or out of bounds.

    Args:
        where: the place that ``data`` comes from; errors put it before the names of the fields.
        fill: use the default of a field that is missing in a group. This is for files, which may be
            older than the field; a new field's default must be the behaviour before it existed.
        context: passed to annotations that use one.
    """
    of_kind: Any = kind
    try:
        built: T = _adapter(of_kind, fill).validate_python(data, context=context)
    except _Refusal as refusal:
        raise Invalid(_sentence(refusal, where)) from None
    return built


@cache
def _adapter(kind: Any, fill: bool) -> TypeAdapter[Any]:
    if dataclasses.is_dataclass(kind):
        return TypeAdapter(_from_table(kind, fill, inner=False))
    return TypeAdapter(kind, config=_STRICT)


def _from_table(kind: Any, fill: bool, *, inner: bool = True) -> Any:
    """Returns the annotation of a table from which ``kind`` is built.

    Pydantic's own schema of a dataclass does not do: it makes each field with a default optional,
    and if it is strict, it accepts only instances of ``kind``.
    """
    fields: dict[str, Any] = {}
    hints = get_type_hints(kind, include_extras=True)
    for each in dataclasses.fields(kind):
        hint = hints[each.name]
        field = _from_table(hint, fill) if dataclasses.is_dataclass(hint) else hint
        fields[each.name] = NotRequired[field] if fill and inner else field
    table = _TypedDict(kind.__name__, fields)
    table.__pydantic_config__ = _STRICT
    return Annotated[table, AfterValidator(lambda found: kind(**found))]


_MAX_NAMES, _LONGEST_NAME = 20, 40  # in an error: a stranger may have chosen the names
_UNEQUAL = ("missing", "extra_forbidden")
_WRONG = {
    "greater_than_equal": ": choose {ge} or more",
    "greater_than": ": choose more than {gt}",
    "less_than_equal": ": choose at most {le}",
    "less_than": ": choose less than {lt}",
    "finite_number": ": choose a finite number",
    "literal_error": ": choose {expected}",
    "string_too_long": ": choose at most {max_length} characters",
    "too_long": ": choose at most {max_length} of them",
    "too_short": ": choose at least {min_length} of them",
    "int_type": ", which is not a whole number",
    "float_type": ", which is not a number",
    "bool_type": ", which is not true or false",
    "string_type": ", which is not a text",
    "string_pattern_mismatch": ", which is not a name",
    "bytes_type": ", which is not bytes",
    "tuple_type": ", which is not a list",
    "is_instance_of": ", which is not a {class}",
}
"""End of the sentence about a wrong value, by pydantic's type of the error."""


def _sentence(refusal: _Refusal, where: str) -> str:
    """Returns a sentence about the first wrong field, with what to choose instead."""
    errors: list[Any] = refusal.errors(include_url=False)

    def dotted(*loc: Any) -> str:
        return ".".join(str(part) for part in (where, *loc) if part != "")

    if unequal := [each["loc"] for each in errors if each["type"] in _UNEQUAL]:
        *group, _ = unequal[0]
        names = sorted(str(name)[:_LONGEST_NAME] for *of, name in unequal if of == group)
        listed = ", ".join(names[:_MAX_NAMES]) + ("" if len(names) <= _MAX_NAMES else " …")
        place = dotted(*group)
        return f"{place + ' has ' if place else ''}a missing or unknown field: {listed}"
    kind, loc, ctx = (errors[0].get(part) for part in ("type", "loc", "ctx"))
    if kind == "value_error":
        return str(ctx["error"])
    if kind == "dict_type":
        return f"{dotted(*loc)} should be a table of settings"
    told = {name: f"{v:g}" if type(v) is float else v for name, v in (ctx or {}).items()}
    wrong = _WRONG.get(kind, ", which is not what it should be").format(**told)
    return f"{dotted(*loc)} is {reprlib.repr(errors[0]['input'])}{wrong}"
