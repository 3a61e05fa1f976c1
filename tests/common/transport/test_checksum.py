"""Every bit of a message is under its checksum."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.transport.checksum import DamagedMessage, seal, unseal


@given(st.text(min_size=1), st.binary(max_size=300), st.binary(max_size=40), st.data())
def test_one_wrong_bit_is_noticed_wherever_it_is(
    key: str, payload: bytes, attachment: bytes, data: st.DataObject
) -> None:
    sealed = seal(key, payload, attachment)
    assert unseal(key, payload, sealed) == attachment
    both = bytearray(payload + sealed)
    bit = data.draw(st.integers(0, 8 * len(both) - 1))
    both[bit // 8] ^= 1 << bit % 8
    with pytest.raises(DamagedMessage):
        unseal(key, bytes(both[: len(payload)]), bytes(both[len(payload) :]))
    with pytest.raises(DamagedMessage):
        unseal(key + "x", payload, sealed)


def test_a_message_without_a_checksum_is_damaged() -> None:
    for sealed in (b"", b"123"):
        with pytest.raises(DamagedMessage, match="another version"):
            unseal("key", b"payload", sealed)
