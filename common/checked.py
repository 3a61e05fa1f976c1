"""The one checker of what comes from outside: messages, configurations, journals.

A type declares its fields with their bounds (``Annotated[int, Ge(0), Lt(2**63)]``), and `build`
makes one of it from plain data, or says in one sentence which field is wrong. It is strict: a
field is neither missing nor unknown, nothing is converted but a whole number where a float is
meant (`Exact` forbids that too), no number is NaN or infinite, and no text is long.
"""

import dataclasses
import reprlib
from functools import cache
from typing import Annotated, Any, NotRequired, TypeVar, get_type_hints

from annotated_types import Ge, Le
from pydantic import AfterValidator, ConfigDict, GetPydanticSchema, Strict, TypeAdapter
from pydantic import ValidationError as _Refusal
from pydantic_core import core_schema
from typing_extensions import TypedDict

MAX_TEXT = 200
"""Characters of a text."""
MAX_COUNT = 2**63 - 1
MAX_SIZE = 1e9
"""Bound of rewards, scores and vectors: sums and squares of such numbers stay finite."""

_STRICT = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, str_max_length=MAX_TEXT)


def _only(kind: Any) -> GetPydanticSchema:
    return GetPydanticSchema(
        lambda source, handler: core_schema.chain_schema(
            [core_schema.is_instance_schema(kind, cls_repr=_NAMES[kind]), handler(source)]
        )
    )


_ROW = (list, tuple)
_NAMES: dict[Any, str] = {float: "float", _ROW: "row"}
Exact = _only(float)
"""Admits floats only, which a message can tell from whole numbers and a file cannot."""

Count = Annotated[int, Ge(0), Le(MAX_COUNT)]
Share = Annotated[float, Exact, Ge(0), Le(1)]
Size = Annotated[float, Exact, Ge(-MAX_SIZE), Le(MAX_SIZE)]
"""A number of either sign, as large as rewards and scores may be."""
Positive = Annotated[float, Exact, Ge(0)]

T = TypeVar("T")
Rows = Annotated[tuple[Annotated[T, _only(_ROW)], ...], Strict(False)]
"""Named tuples, each written as a list of its values, without their names."""
Values = Annotated[tuple[T, ...], Strict(False)]
"""As many values as there are, written as a list."""


_TypedDict: Any = TypedDict  # which type checkers admit with constants only


class Invalid(ValueError):
    """Data that a declaration does not admit; the text names the field and says what is wrong."""


def build(
    kind: type[T], data: Any, where: str = "", *, fill: bool = False, context: Any = None
) -> T:
    """Returns a ``kind`` made from plain data: dataclasses from tables, named tuples from lists.

    Args:
        where: the place that ``data`` comes from, put before the names of its fields.
        fill: take the default of a field that is missing in a group. For files, which may be older
            than the field; so a new field's default is what was done before there was one.
        context: handed to the annotations that read one.

    Raises:
        Invalid: a field is missing, unknown, of the wrong type, or out of bounds.
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
    """Returns the annotation of a table that ``kind`` is made from.

    Pydantic's own schema of a dataclass makes each field with a default optional, and a strict one
    admits only what is a ``kind`` already.
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


def _sentence(refusal: _Refusal, where: str) -> str:
    """Returns what is wrong with the first field at fault, and what to choose instead."""
    errors: list[Any] = refusal.errors(include_url=False)

    def dotted(*loc: Any) -> str:
        return ".".join(str(part) for part in (where, *loc) if part != "")

    for error in errors:
        *group, _ = loc = error["loc"] or ("",)
        unequal = [
            str(each["loc"][-1])
            for each in errors
            if each["type"] in ("missing", "extra_forbidden") and [*each["loc"][:-1]] == group
        ]
        if error["type"] in ("missing", "extra_forbidden"):
            place = dotted(*group)
            listed = ", ".join(sorted(unequal))
            return f"{place + ' has ' if place else ''}a missing or unknown field: {listed}"
    error = errors[0]
    loc, ctx = error["loc"], error.get("ctx", {})
    if error["type"] == "value_error":
        return str(ctx["error"])
    if error["type"] == "dict_type":
        return f"{dotted(*loc)} should be a table of settings"
    return f"{dotted(*loc)} is {reprlib.repr(error['input'])}{_advice(error['type'], ctx)}"


def _advice(kind: str, ctx: dict[str, Any]) -> str:
    told = {k: f"{v:g}" if type(v) is float else v for k, v in ctx.items()}
    bounds = {
        "greater_than_equal": "{ge} or more",
        "greater_than": "more than {gt}",
        "less_than_equal": "at most {le}",
        "less_than": "less than {lt}",
        "finite_number": "a finite number",
        "literal_error": "{expected}",
        "string_too_long": "at most {max_length} characters",
        "too_long": "at most {max_length} of them",
        "too_short": "at least {min_length} of them",
    }
    kinds = {
        "int_type": "a whole number",
        "float_type": "a number",
        "bool_type": "true or false",
        "string_type": "a text",
        "bytes_type": "bytes",
        "tuple_type": "a list",
        "is_instance_of": "a {class}",
    }
    if kind in bounds:
        return f": choose {bounds[kind].format(**told)}"
    return f", which is not {kinds.get(kind, 'what it should be').format(**told)}"
