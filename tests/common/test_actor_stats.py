"""An actor's counters on the wire."""

import dataclasses
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.actor_stats import ActorStats, decode_stats, encode_stats
from common.errors import MessageError
from common.wire import pack

COUNTS = st.integers(0, 2**63 - 1)
AMOUNTS = st.floats(0, allow_infinity=False)
GOOD = ActorStats("a", "actor", 1, False, 2, 3.0, 0.5, 4, 5, 6, 7, 8, 0.0, 1.0, 0.9)
OF_TYPE = {type_: [n for n, v in vars(GOOD).items() if type(v) is type_] for type_ in (int, float)}


@given(
    st.builds(
        ActorStats,
        name=st.text(max_size=64),
        role=st.sampled_from(["actor", "evaluator"]),
        leaving=st.booleans(),
        **dict.fromkeys(OF_TYPE[int], COUNTS),
        **dict.fromkeys(OF_TYPE[float], AMOUNTS),
    )
)
def test_stats_survive_the_wire(stats: ActorStats) -> None:
    assert decode_stats(encode_stats(stats)) == stats


@pytest.mark.parametrize("name", [each.name for each in dataclasses.fields(ActorStats)])
@pytest.mark.parametrize("value", [None, [], b"actor"])
def test_a_field_of_another_type_is_told(name: str, value: Any) -> None:
    with pytest.raises(MessageError, match=name):
        decode_stats(pack(dataclasses.asdict(GOOD) | {name: value}))


@pytest.mark.parametrize("name", OF_TYPE[int])
def test_counters_are_whole_and_not_negative(name: str) -> None:
    for value in (-1, 1.0, True, 2**63):
        with pytest.raises(MessageError, match=name):
            decode_stats(pack(dataclasses.asdict(GOOD) | {name: value}))


@pytest.mark.parametrize("name", OF_TYPE[float])
def test_amounts_are_finite_and_not_negative(name: str) -> None:
    for value in (-0.1, 1, float("nan"), float("inf")):
        with pytest.raises(MessageError, match=name):
            decode_stats(pack(dataclasses.asdict(GOOD) | {name: value}))


def test_there_are_two_roles() -> None:
    with pytest.raises(MessageError, match="role is 'learner'"):
        decode_stats(pack(dataclasses.asdict(GOOD) | {"role": "learner"}))
