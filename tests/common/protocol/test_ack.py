"""The acknowledgement of an insert."""

import dataclasses
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import MessageError
from common.protocol.ack import Ack
from common.protocol.wire import pack

COUNTS = st.integers(0, 2**63 - 1)
GOOD = Ack(
    "stored", throttle=False, finished=False, agent_steps=640, difficulty=0.5, weights_version=7
)


@given(
    st.builds(
        Ack,
        st.sampled_from(["stored", "duplicate", "poll"]),
        st.booleans(),
        st.booleans(),
        COUNTS,
        st.floats(0, 1),
        COUNTS,
    )
)
def test_an_ack_survives_the_wire(ack: Ack) -> None:
    assert Ack.decode(ack.encode()) == ack


@pytest.mark.parametrize("name", [each.name for each in dataclasses.fields(Ack)])
def test_a_missing_field_is_told(name: str) -> None:
    message: dict[str, Any] = dataclasses.asdict(GOOD)
    del message[name]
    with pytest.raises(MessageError, match=name):
        Ack.decode(pack(message))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("status", "lost"),
        ("status", 1),
        ("throttle", 1),
        ("finished", None),
        ("agent_steps", -1),
        ("agent_steps", 1.0),
        ("difficulty", 1.01),
        ("weights_version", True),
        ("weights_version", 2**63),
    ],
)
def test_a_wrong_field_is_told(name: str, value: Any) -> None:
    with pytest.raises(MessageError, match=name):
        Ack.decode(pack(dataclasses.asdict(GOOD) | {name: value}))


@given(st.binary(max_size=50))
def test_anything_else_is_refused(payload: bytes) -> None:
    with pytest.raises(MessageError):
        Ack.decode(payload)
