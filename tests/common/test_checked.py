"""The checker: each rule of strictness, and its sentence."""

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, NamedTuple

import pytest
from annotated_types import Ge, Gt, Le, Lt, MaxLen

from common.checked import Amount, Count, Fraction, Invalid, Rows, Score, Values, build


class Pair(NamedTuple):
    value: Score
    amount: Count
    later: Count = 7


@dataclass(frozen=True)
class Group:
    share: Annotated[float, Ge(0), Le(1)] = 0.5
    below: Annotated[float, Gt(0), Lt(1)] = 0.5
    kind: Literal["one", "two"] = "one"


@dataclass(frozen=True)
class Table:
    whole: Count = 0
    any_sign: int = 0
    real: float = 0.0
    amount: Amount = 0.0
    text: str = ""
    flag: bool = False
    blob: bytes = b""
    maybe: bool | None = None
    pairs: Annotated[Rows[Pair], MaxLen(2)] = ()
    counts: Values[Count] = ()
    group: Group = field(default_factory=Group)


def table(**changes: Any) -> dict[str, Any]:
    good = {name: value for name, value in vars(Table()).items() if name != "group"}
    return {**good, "group": dict(vars(Group())), **changes}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("whole", 0),
        ("whole", 2**63 - 1),
        ("any_sign", -(2**70)),
        ("real", -1e300),
        ("amount", 0.0),
        ("amount", 1e300),
        ("text", ""),
        ("text", "x" * 200),
        ("flag", True),
        ("blob", b"x" * 1_000),
        ("maybe", True),
        ("counts", (1, 2**63 - 1)),
    ],
)
def test_a_field_of_its_type_and_within_bounds_is_taken(name: str, value: Any) -> None:
    assert build(Table, table(**{name: value})) == Table(**{name: value})


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("whole", None, "is None, which is not a whole number"),
        ("whole", True, "is True, which is not a whole number"),
        ("whole", 1.0, "is 1.0, which is not a whole number"),
        ("whole", "1", "is '1', which is not a whole number"),
        ("whole", -1, "is -1: choose 0 or more"),
        ("whole", 2**63, "is 9223372036854775808: choose at most 9223372036854775807"),
        ("real", "1.0", "is '1.0', which is not a number"),
        ("real", True, "is True, which is not a number"),
        ("real", float("nan"), "is nan: choose a finite number"),
        ("amount", -0.1, "is -0.1: choose 0 or more"),
        ("amount", float("inf"), "is inf: choose a finite number"),
        ("amount", float("-inf"), "is -inf: choose a finite number"),
        ("text", b"text", "is b'text', which is not a text"),
        ("text", "x" * 201, "choose at most 200 characters"),
        ("flag", 1, "is 1, which is not true or false"),
        ("flag", "true", "is 'true', which is not true or false"),
        ("blob", "text", "is 'text', which is not bytes"),
        ("blob", None, "is None, which is not bytes"),
        ("maybe", 0, "is 0, which is not true or false"),
        ("counts", {}, "is {}, which is not a list"),
        ("counts", "12", "is '12', which is not a list"),
        ("counts", [1, -1], "choose 0 or more"),
        ("pairs", [[0.0, 1]] * 3, "choose at most 2 of them"),
    ],
)
def test_anything_else_is_refused_by_name(name: str, value: Any, sentence: str) -> None:
    with pytest.raises(Invalid) as caught:
        build(Table, table(**{name: value}), "here")
    assert str(caught.value).startswith(f"here.{name}")
    assert str(caught.value).endswith(sentence)


def test_a_long_value_is_not_repeated() -> None:
    with pytest.raises(Invalid) as caught:
        build(Table, table(whole="x" * 10_000))
    assert len(str(caught.value)) < 100


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("share", 1.1, "group.share is 1.1: choose at most 1"),
        ("below", 1, "group.below is 1: choose less than 1"),
        ("below", 0, "group.below is 0: choose more than 0"),
        ("kind", "three", "group.kind is 'three': choose 'one' or 'two'"),
        ("kind", ["one"], "group.kind is ['one']: choose 'one' or 'two'"),
        ("share", "0.5", "group.share is '0.5', which is not a number"),
        ("share", 10**400, "which is not a number"),
    ],
)
def test_a_field_of_a_group_has_its_dotted_name(name: str, value: Any, sentence: str) -> None:
    with pytest.raises(Invalid) as caught:
        build(Table, table(group=vars(Group()) | {name: value}))
    assert str(caught.value).endswith(sentence)


def test_a_whole_number_does_for_a_float() -> None:
    found = build(Table, table(group=vars(Group()) | {"share": 1}))
    assert type(found.group.share) is float
    assert found.group.share == 1.0


@pytest.mark.parametrize("data", [None, 5, "text", [], [("whole", 1)]])
def test_what_is_no_table_is_refused(data: Any) -> None:
    with pytest.raises(Invalid, match=r"^here should be a table of settings$"):
        build(Table, data, "here")
    with pytest.raises(Invalid, match=r"^here\.group should be a table of settings$"):
        build(Table, table(group=data), "here")


def test_missing_and_unknown_fields_are_named_together() -> None:
    data = table(zz=1, aa=2)
    del data["whole"]
    with pytest.raises(Invalid, match=r"^here has a missing or unknown field: aa, whole, zz$"):
        build(Table, data, "here")
    with pytest.raises(Invalid, match=r"^a missing or unknown field: aa, whole, zz$"):
        build(Table, data)


def test_only_a_groups_fields_may_be_missing_from_a_file() -> None:
    assert build(Table, table(group={}), fill=True) == Table()
    with pytest.raises(Invalid, match=r"group has a missing or unknown field: below, kind, share$"):
        build(Table, table(group={}))
    with pytest.raises(Invalid, match=r"group has a missing or unknown field: new$"):
        build(Table, table(group={"new": 1}), fill=True)
    data = table()
    del data["group"]
    with pytest.raises(Invalid, match=r"^a missing or unknown field: group$"):
        build(Table, data, fill=True)


def test_rows_are_lists_of_values() -> None:
    found = build(Table, table(pairs=[[1.0, 2], (3.0, 4, 5)]))
    assert found.pairs == (Pair(1.0, 2, 7), Pair(3.0, 4, 5))
    assert build(Pair, [1.0, 2]) == Pair(1.0, 2)


@pytest.mark.parametrize(
    "row",
    [
        None,
        5.0,
        "ab",
        [],
        [1.0],
        [1.0, 2, 3, 4],
        ["1", 2],
        [1.0, 2.0],
        [1.0, True],
        [1.0, -1],
        [1.1e9, 1],
        [-1.1e9, 1],
        [float("nan"), 2],
        {"value": 1.0, "amount": 2},
    ],
)
def test_a_row_of_other_values_is_refused(row: Any) -> None:
    with pytest.raises(Invalid, match=r"^pairs\.0"):
        build(Table, table(pairs=[row]))


def test_a_share_ends_at_1() -> None:
    assert build(Values[Fraction], [0.0, 1.0]) == (0.0, 1.0)
    with pytest.raises(Invalid, match="choose at most 1"):
        build(Values[Fraction], [1.01])


def test_a_sentence_is_short_whatever_a_stranger_sent() -> None:
    strange = {f"{number:05}" + "x" * 1_000: 1 for number in range(1_000)}
    with pytest.raises(Invalid) as refused:
        build(Table, strange | table())
    assert len(str(refused.value)) < 1_000
