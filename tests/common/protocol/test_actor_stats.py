"""An actor's counters on the wire."""

import dataclasses
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common import press_latency as key_times
from common.checked import NAME
from common.errors import MessageError
from common.metrics import METRICS
from common.protocol.actor_stats import TOTALS, ActorStats
from common.protocol.wire import pack

COUNTS = st.integers(0, 2**63 - 1)
PLACES = key_times.COUNTS
KEY_TIMES = st.sampled_from([(), tuple(range(PLACES)), (2**63 - 1,) * PLACES])
AMOUNTS = st.floats(0, allow_infinity=False)
GOOD = ActorStats("a", "actor", 1, False, 2, 3.0, 0.5, 4, 5, 6, 7, 8, 0.0, 1)
OF_TYPE = {type_: [n for n, v in vars(GOOD).items() if type(v) is type_] for type_ in (int, float)}


@given(
    st.builds(
        ActorStats,
        name=st.from_regex(NAME, fullmatch=True),
        role=st.sampled_from(["actor", "evaluator"]),
        leaving=st.booleans(),
        key_times=KEY_TIMES,
        **dict.fromkeys(OF_TYPE[int], COUNTS),
        **dict.fromkeys(OF_TYPE[float], AMOUNTS),
    )
)
def test_stats_survive_the_wire(stats: ActorStats) -> None:
    assert ActorStats.decode(stats.encode()) == stats


@pytest.mark.parametrize("name", [each.name for each in dataclasses.fields(ActorStats)])
@pytest.mark.parametrize("value", [None, [-1], b"actor"])
def test_a_field_of_another_type_is_told(name: str, value: Any) -> None:
    with pytest.raises(MessageError, match=name):
        ActorStats.decode(pack(dataclasses.asdict(GOOD) | {name: value}))


@pytest.mark.parametrize("name", OF_TYPE[int])
def test_counters_are_whole_and_not_negative(name: str) -> None:
    for value in (-1, 1.0, True, 2**63):
        with pytest.raises(MessageError, match=name):
            ActorStats.decode(pack(dataclasses.asdict(GOOD) | {name: value}))


@pytest.mark.parametrize("name", OF_TYPE[float])
def test_amounts_are_finite_and_not_negative(name: str) -> None:
    for value in (-0.1, True, "1", float("nan"), float("inf")):
        with pytest.raises(MessageError, match=name):
            ActorStats.decode(pack(dataclasses.asdict(GOOD) | {name: value}))


def test_key_times_are_all_there_or_none() -> None:
    good = dataclasses.asdict(GOOD)
    whole = [3, 0] * (PLACES // 2)
    assert ActorStats.decode(pack(good | {"key_times": whole})).key_times == tuple(whole)
    assert ActorStats.decode(pack(good | {"key_times": []})).key_times == ()
    bad = ([*whole, 0], whole[1:], [*whole[1:], -1], [*whole[1:], 1.0], [*whole[1:], True])
    for value in (*bad, [*whole[1:], 2**63], [*whole[1:], None], 3, "0" * PLACES):
        with pytest.raises(MessageError, match="key_times"):
            ActorStats.decode(pack(good | {"key_times": value}))


def test_each_counter_has_a_total() -> None:
    assert set(TOTALS) == set(OF_TYPE[int]) - {"incarnation", "weights_version", "memory_bytes"}
    assert set(TOTALS.values()) <= METRICS.keys()


def test_there_are_two_roles() -> None:
    with pytest.raises(MessageError, match="role is 'learner'"):
        ActorStats.decode(pack(dataclasses.asdict(GOOD) | {"role": "learner"}))
