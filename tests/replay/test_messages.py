"""Messages between learner and replay: each comes through whole, and nothing else does."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from common.errors import MessageError
from common.protocol.chunk import Game
from common.protocol.message import Message
from common.protocol.step_fields import drawn_fields, zero_steps
from common.protocol.wire import MAX_MESSAGE_BYTES, pack, unpack
from replay.batch import SharedBatch
from replay.chunk_statistics import ChunkStatistics, ReplayProgress
from replay.messages import (
    HeldOutRequest,
    HeldOutStates,
    ProgressRequest,
    SampleRequest,
)


def drawn_values(count: int, width: int) -> dict[str, Any]:
    """Zeros for each field that minibatches carry beside the usual ones."""
    values = zero_steps(count, width)
    return {name: values[name] for name in drawn_fields()}


def a_batch(count: int, frame_stack: int, width: int) -> SharedBatch:
    rng = np.random.default_rng(count)

    def numbers(*shape: int) -> Any:
        return rng.normal(size=shape).astype(np.float32)

    return SharedBatch(
        frames=rng.integers(0, 256, (5 * count, 84, 84), np.uint8),
        stacks=rng.integers(0, 5 * count, (2, count, frame_stack), np.int32)
        if count
        else np.zeros((2, 0, frame_stack), np.int32),
        ids=rng.integers(0, 2**60, count),
        a_tm1=rng.integers(0, 18, count, np.uint8),
        r_t=numbers(count),
        discount_t=numbers(count),
        weights=numbers(count),
        x_tm1=numbers(count, width),
        x_t=numbers(count, width),
        drawn=drawn_values(count, width),
    )


@pytest.mark.parametrize(("count", "frame_stack", "width"), [(1, 4, 0), (3, 1, 5), (0, 4, 2)])
def test_a_batch_comes_through_whole(count: int, frame_stack: int, width: int) -> None:
    batch = a_batch(count, frame_stack, width)
    found = vars(SharedBatch.decode(batch.encode()))
    drawn = found.pop("drawn")
    assert drawn.keys() == batch.drawn.keys()
    for name, array in {**found, **drawn}.items():
        expected = batch.drawn[name] if name in drawn else getattr(batch, name)
        assert array.dtype == expected.dtype
        np.testing.assert_array_equal(array, expected)


@pytest.mark.parametrize(("count", "frame_stack", "width"), [(1, 4, 0), (3, 1, 5), (0, 4, 2)])
def test_a_batch_can_be_made_whole(count: int, frame_stack: int, width: int) -> None:
    shared = SharedBatch.decode(a_batch(count, frame_stack, width).encode())
    batch = shared.whole()
    assert batch.s_tm1.shape == batch.s_t.shape == (count, frame_stack, 84, 84)
    for at in range(count):
        for place in range(frame_stack):
            for states, which in ((batch.s_tm1, 0), (batch.s_t, 1)):
                frame = shared.frames[shared.stacks[which, at, place]]
                np.testing.assert_array_equal(states[at, place], frame)
    assert batch.s_tm1.flags.writeable  # or a tensor of them would have to be another copy
    for name in ("ids", "a_tm1", "r_t", "discount_t", "weights", "x_tm1", "x_t"):
        assert getattr(batch, name) is getattr(shared, name)


@pytest.mark.parametrize(("step", "priority"), [(-1, 1.0), (1, -1.0), (1, -np.inf)])
def test_negative_priorities_and_ids_are_refused(step: int, priority: float) -> None:
    asked = SampleRequest(0, 0.0, np.array([0, step]), np.array([np.nan, priority], np.float32))
    with pytest.raises(MessageError, match="not be negative"):
        SampleRequest.decode(asked.encode())


@pytest.mark.parametrize("wrong", [-1, 5, 2**31 - 1])
def test_a_stack_of_frames_that_are_not_there_is_refused(wrong: int) -> None:
    batch = a_batch(1, 4, 0)
    batch.stacks[1, 0, 2] = wrong
    with pytest.raises(MessageError, match="5 frames"):
        SharedBatch.decode(batch.encode())


def test_a_small_message_cannot_ask_for_huge_states() -> None:
    count = MAX_MESSAGE_BYTES // (2 * 4 * 84 * 84)
    batch = a_batch(1, 4, 0)
    stacks = np.zeros((2, count + 1, 4), np.int32)
    empty = np.zeros(count + 1, np.float32)
    large = replace(
        batch,
        stacks=stacks,
        ids=np.zeros(count + 1, np.int64),
        a_tm1=np.zeros(count + 1, np.uint8),
        r_t=empty,
        discount_t=empty,
        weights=empty,
        x_tm1=empty[:, None],
        x_t=empty[:, None],
        drawn=drawn_values(count + 1, 1),
    )
    with pytest.raises(MessageError, match="over the bound"):
        SharedBatch.decode(large.encode())


@pytest.mark.parametrize("name", [each.name for each in fields(SharedBatch)])
def test_a_batch_without_one_of_its_arrays_is_refused(name: str) -> None:
    message = unpack(a_batch(2, 4, 0).encode())
    del message["schema"], message[name]
    with pytest.raises(MessageError, match=name):
        SharedBatch.decode(pack(message))


def test_a_batch_of_nothing_is_refused() -> None:
    with pytest.raises(MessageError, match="ids"):
        SharedBatch.decode(pack({"drawn": {}}))


STATISTICS = st.builds(
    ChunkStatistics,
    index=st.integers(0, 2**62),
    agent_steps=st.integers(0, 2**62),
    steps=st.integers(1, 1_024),
    actor=st.text(max_size=20),
    epsilon=st.floats(0, 1),
    weights_version=st.integers(0, 2**62),
    staleness=st.integers(0, 2**62),
    valid=st.integers(0, 1_024),
    matched=st.integers(0, 1_024),
    games=st.lists(
        st.builds(Game, st.floats(-1e6, 1e6), st.integers(0, 2**31 - 1)), max_size=3
    ).map(tuple),
    follows=st.integers(0, 1_024),
)


@given(st.lists(STATISTICS, max_size=3).map(tuple), st.booleans(), st.integers(0, 2**62))
def test_progress_comes_through_whole(
    statistics: tuple[ChunkStatistics, ...], throttle: bool, number: int
) -> None:
    progress = ReplayProgress(number, 1, 2, 3, 4, 5, throttle, 6, 7, number, statistics)
    assert ReplayProgress.decode(progress.encode()) == progress


@pytest.mark.parametrize("bad", [None, [], [1], [[1, 2, 3]], [[0, 1, 1, "a", 1, 0, 0, 0, 0, []]]])
def test_statistics_of_other_kinds_are_refused(bad: Any) -> None:
    message = unpack(ReplayProgress(0, 1, 2, 3, 4, 5, False, 6, 7, 8, ()).encode())
    del message["schema"]
    with pytest.raises(MessageError):
        ReplayProgress.decode(pack({**message, "facts": bad} if bad != [] else {"facts": bad}))


def test_requests_come_through_whole() -> None:
    for request in (
        HeldOutRequest(9),
        HeldOutRequest(9, 40),
        ProgressRequest(3, 640),
    ):
        assert type(request).decode(request.encode()) == request
    assert ProgressRequest.decode(ProgressRequest(3, None).encode()).goal is None


@given(hnp.arrays(np.float32, st.integers(0, 9), elements=st.floats(0, 1, width=32)))
def test_priorities_come_through_whole(priorities: Any) -> None:
    ids = np.arange(len(priorities)) + 2**40
    found = SampleRequest.decode(SampleRequest(640, 0.5, ids, priorities).encode())
    assert (found.drawn, found.timeout) == (640, 0.5)
    np.testing.assert_array_equal(found.ids, ids)
    np.testing.assert_array_equal(found.priorities, priorities)


def test_held_out_states_come_through_whole() -> None:
    batch = a_batch(3, 4, 2).whole()
    held = HeldOutStates.decode(HeldOutStates(batch.s_tm1, batch.x_tm1).encode())
    np.testing.assert_array_equal(held.frames, batch.s_tm1)
    np.testing.assert_array_equal(held.vectors, batch.x_tm1)


KINDS: list[type[Message]] = [
    SharedBatch,
    ReplayProgress,
    SampleRequest,
    HeldOutRequest,
    HeldOutStates,
    ProgressRequest,
]


@given(st.sampled_from(KINDS), st.binary(max_size=60))
def test_random_bytes_are_refused(kind: type[Message], payload: bytes) -> None:
    with pytest.raises(MessageError):
        kind.decode(payload)


@given(
    st.sampled_from(KINDS),
    st.dictionaries(
        st.sampled_from(["ids", "drawn", "timeout", "count", "since", "statistics", "stacks"]),
        st.none() | st.integers(-(2**63), 2**63) | st.floats() | st.text(max_size=3) | st.just([]),
    ),
)
def test_maps_of_anything_are_decoded_or_refused(
    kind: type[Message], message: dict[str, Any]
) -> None:
    try:
        decoded = kind.decode(pack(message))
    except MessageError:
        return
    # What passes can only be the requests whose every field may be among these.
    assert kind in (SampleRequest, HeldOutRequest)
    assert vars(decoded) == message
