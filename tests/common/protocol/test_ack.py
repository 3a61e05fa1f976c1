"""The acknowledgement of an insert."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import MessageError
from common.protocol.ack import Ack, decode_ack, encode_ack
from common.protocol.wire import pack

COUNTS = st.integers(0, 2**63 - 1)
GOOD = Ack("stored", throttle=False, finished=False, agent_steps=640, weights_version=7)


@given(
    st.builds(
        Ack,
        st.sampled_from(["stored", "duplicate", "poll"]),
        st.booleans(),
        st.booleans(),
        COUNTS,
        COUNTS,
    )
)
def test_an_ack_survives_the_wire(ack: Ack) -> None:
    assert decode_ack(encode_ack(ack)) == ack


@pytest.mark.parametrize("name", Ack._fields)
def test_a_missing_field_is_told(name: str) -> None:
    message: dict[str, Any] = GOOD._asdict()
    del message[name]
    with pytest.raises(MessageError, match=name):
        decode_ack(pack(message))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("status", "lost"),
        ("status", 1),
        ("throttle", 1),
        ("finished", None),
        ("agent_steps", -1),
        ("agent_steps", 1.0),
        ("weights_version", True),
        ("weights_version", 2**63),
    ],
)
def test_a_wrong_field_is_told(name: str, value: Any) -> None:
    with pytest.raises(MessageError, match=name):
        decode_ack(pack(GOOD._asdict() | {name: value}))


@given(st.binary(max_size=50))
def test_anything_else_is_refused(payload: bytes) -> None:
    with pytest.raises(MessageError):
        decode_ack(payload)
