import copy
import dataclasses
import errno
import json
import os
import threading
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from common.checked import MAX_COUNT
from common.errors import InputError, MessageError
from common.protocol.chunk import Chunk, Game
from common.settings.config import RunConfig
from replay.batch import Batch
from replay.journal import Entry, Journal
from replay.replay_buffer import ReplayBuffer
from replay.ring import Ring
from tests.patience import PATIENCE
from tests.replay.replay_reference import (
    GOES_ON,
    TERMINATES,
    TRUNCATES,
    Actor,
    ListReplay,
    VectorConfig,
    expected_transition,
    make_config,
    number_of,
    vector_of,
)

ENDING = st.sampled_from([GOES_ON] * 8 + [TERMINATES, TRUNCATES])
EVENT = st.tuples(
    st.integers(0, 2),
    st.sampled_from(["send"] * 6 + ["lose", "delay", "again", "restart"]),
    st.lists(ENDING, min_size=1, max_size=7),
)


def check_batch(batch: Batch, actors: list[Actor], config: RunConfig) -> set[int]:
    """Compare each transition with its actor's own record; the numbers of those drawn."""
    drawn: set[int] = set()
    for at in range(len(batch.ids)):
        stack = [number_of(frame) for frame in batch.s_tm1[at]]
        drawn.add(stack[-1])
        actor = actors[stack[-1] // 1_000_000]
        expected = expected_transition(actor, stack[-1], config)
        assert stack == expected.s_tm1
        assert batch.a_tm1[at] == expected.action
        assert batch.r_t[at] == pytest.approx(expected.reward, rel=1e-6)
        assert batch.discount_t[at] == pytest.approx(expected.discount, rel=1e-6)
        width = config.vector_width
        assert (batch.x_tm1[at] == vector_of(stack[-1], width)).all()
        if expected.s_t is not None:
            assert [number_of(frame) for frame in batch.s_t[at]] == expected.s_t
            assert (batch.x_t[at] == vector_of(expected.s_t[-1], width)).all()
    return drawn


@settings(
    max_examples=100,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(
    events=st.lists(EVENT, min_size=5, max_size=40),
    frame_stack=st.sampled_from([2, 3, 4, 4]),
    n_step=st.sampled_from([1, 3, 5]),
    clip=st.booleans(),
    losses_end=st.booleans(),
    sampler=st.sampled_from(["uniform", "prioritised"]),
    capacity=st.sampled_from([24, 40, 90]),
)
def test_it_gives_what_a_replay_of_lists_gives(
    tmp_path_factory: pytest.TempPathFactory,
    events: list[tuple[int, str, list[int]]],
    frame_stack: int,
    n_step: int,
    clip: bool,
    losses_end: bool,
    sampler: str,
    capacity: int,
) -> None:
    """Several actors, ends and cuts of episodes, lost, late and repeated chunks, wrap, restarts."""
    folder = tmp_path_factory.mktemp("replay")
    config = make_config(
        VectorConfig,
        frame_stack=frame_stack,
        n_step=n_step,
        clip_rewards=clip,
        losses_end_returns=losses_end,
        sampler=sampler,
        capacity=capacity,
    )
    rng = np.random.default_rng(0)
    actors = [Actor(str(n), frame_stack, 3, 1_000_000 * n) for n in range(3)]
    late: list[Chunk] = []
    buffer, reference = ReplayBuffer(config, folder), ListReplay(config)
    inserted = drawn = 0
    sent: list[Chunk] = []
    for who, what, endings in events:
        arriving: list[Chunk] = []
        if what == "restart":
            buffer.close()
            buffer = ReplayBuffer(config, folder)
        elif what == "again":
            arriving = sent[-1:]
        else:
            chunk = actors[who].live(endings, rng)
            if what == "delay":
                late.append(chunk)
            elif what == "send":
                arriving = [chunk, *late]
                late = []
        for chunk in arriving:
            new = reference.insert(chunk)
            ack = buffer.insert(chunk)
            inserted += new * len(chunk)
            assert ack.status == ("stored" if new else "duplicate")
            assert ack.agent_steps == inserted
        sent += arriving
        expected = reference.numbers()
        progress = buffer.progress(0)
        assert progress.samplable == len(expected)
        assert progress.stored == reference.steps()
        batch = buffer.sample(drawn, 0.0)
        assert (batch is None) == (not expected)
        if batch is not None:
            assert check_batch(batch, actors, config) <= expected
    buffer.close()


def long_run(config: RunConfig, folder: Path, chunks: int, steps: int = 8) -> ReplayBuffer:
    buffer, actor = ReplayBuffer(config, folder), Actor("a", 4)
    rng = np.random.default_rng(0)
    for _ in range(chunks):
        buffer.insert(actor.live([GOES_ON] * steps, rng))
    return buffer


def test_every_step_that_can_be_drawn_is_drawn(tmp_path: Path) -> None:
    buffer = long_run(make_config(batch_size=256, capacity=64), tmp_path, 20)
    drawn: set[int] = set()
    for _ in range(20):
        batch = buffer.sample(0, 0.0)
        assert batch is not None
        drawn |= set(batch.ids.tolist())
    # 64 steps stay; the first 3 lack frames of the one before, the last 3 their return
    assert sorted(drawn) == list(range(20 * 8 - 64 + 3, 20 * 8 - 3))
    assert buffer.progress(0).samplable == 64 - 6


@pytest.mark.parametrize("n_step", [1, 3])
@pytest.mark.parametrize("sampler", ["uniform", "prioritised"])
def test_a_shared_batch_made_whole_is_the_plain_one(
    tmp_path: Path, n_step: int, sampler: str
) -> None:
    config = make_config(VectorConfig, n_step=n_step, sampler=sampler)
    buffer, actor = ReplayBuffer(config, tmp_path), Actor("a", 4, width=3)
    rng = np.random.default_rng(0)
    for endings in ([GOES_ON] * 20, [GOES_ON, TERMINATES] * 5, [GOES_ON, TRUNCATES] * 5):
        buffer.insert(actor.live(endings, rng))
    for _ in range(10):
        state = copy.deepcopy(buffer._rng)
        plain = buffer.sample(0, 0.0)
        buffer._rng = state
        shared = buffer.sample_shared(0, 0.0)
        assert plain is not None
        assert shared is not None
        assert len(shared.frames) < 2 * 16 * 4
        found = shared.whole()._asdict()
        drawn = found.pop("drawn")
        assert drawn.keys() == plain.drawn.keys()
        for name, array in {**found, **drawn}.items():
            expected = plain.drawn[name] if name in drawn else getattr(plain, name)
            assert array.dtype == expected.dtype
            np.testing.assert_array_equal(array, expected, name)


def test_the_limiter_holds_actors_and_the_learner(tmp_path: Path) -> None:
    config = make_config(learning_starts=16, ratio_tolerance=8, batch_size=32)  # 8 draws per step
    buffer, actor, rng = ReplayBuffer(config, tmp_path), Actor("a", 4), np.random.default_rng(0)
    assert buffer.insert(actor.live([GOES_ON] * 15, rng)).throttle is False
    assert buffer.sample(0, 0.0) is None  # 15 < 16
    assert buffer.insert(actor.live([GOES_ON] * 9, rng)).throttle is False  # 8 steps ahead: allowed
    assert buffer.insert(actor.live([GOES_ON] * 1, rng)).throttle is True
    assert buffer.poll("a").throttle is True
    assert buffer.sample(8, 0.0) is not None
    assert buffer.poll("a").throttle is False
    assert buffer.sample((25 - 16) * 8 + 32, 0.0) is not None  # one batch ahead: 4 of 8 steps
    assert buffer.sample((25 - 16) * 8 + 33, 0.0) is None


def test_who_sends_while_there_is_room_is_ahead_by_no_more_than_a_window(tmp_path: Path) -> None:
    config = make_config(
        learning_starts=16, ratio_tolerance=8, batch_size=32, chunk_steps=2, window=2
    )
    buffer, rng = ReplayBuffer(config, tmp_path), np.random.default_rng(0)
    assert not buffer.insert(Actor("early", 4).live([GOES_ON] * 20, rng)).throttle
    assert buffer.insert(Actor("late", 4).live([GOES_ON] * 8, rng)).throttle  # 4 more than it may
    assert not buffer.admits("early")
    assert not buffer.admits("late")
    buffer.sample(40, 0.0)  # opens the limiter, until the third closes it
    assert buffer.insert(Actor("third", 4).live([GOES_ON] * 4, rng)).throttle
    assert buffer.admits("early")
    assert not buffer.admits("late")


def test_the_count_of_draws_is_the_learners_own(tmp_path: Path) -> None:
    config = make_config(learning_starts=16, ratio_tolerance=8, batch_size=32, train_period=4)
    buffer, actor, rng = ReplayBuffer(config, tmp_path), Actor("a", 4), np.random.default_rng(0)
    for _ in range(5):
        buffer.insert(actor.live([GOES_ON] * 10, rng))
    buffer.weights_version = 9  # updates, of 32 steps each
    assert buffer.sample(9 * 32, 0.0) is not None
    assert buffer.progress(0).throttle is False  # (50 - 16) * 8 were due
    assert buffer.sample(0, 0.0) is not None  # by somebody who looks on
    assert buffer.progress(0).throttle is False
    buffer.weights_version = 5  # of a learner that goes on from an older checkpoint
    assert buffer.sample(5 * 32, 0.0) is not None
    assert buffer.progress(0).throttle is True


def test_a_held_actor_and_a_waiting_learner_are_woken(tmp_path: Path) -> None:
    config = make_config(learning_starts=16, ratio_tolerance=8, batch_size=32)
    buffer, actor, rng = ReplayBuffer(config, tmp_path), Actor("a", 4), np.random.default_rng(0)
    found: list[Any] = []
    learner = threading.Thread(target=lambda: found.append(buffer.sample(0, 60.0)))
    learner.start()
    buffer.insert(actor.live([GOES_ON] * 30, rng))
    learner.join(30.0)
    assert isinstance(found[0], Batch)
    buffer.released = lambda: found.append(buffer.poll("a"))
    assert buffer.poll("a").throttle
    buffer.sample(40, 0.0)  # of (30 - 16) * 8 that are due, and 64 that may be
    assert found[1:] == []
    buffer.sample(200, 0.0)
    assert [(ack.throttle, ack.finished) for ack in found[1:]] == [(False, False)]
    buffer.sample(201, 0.0)  # it is open already
    assert buffer.insert(actor.live([GOES_ON] * 30, rng)).throttle
    buffer.progress(0, goal=60)
    assert [(ack.throttle, ack.finished) for ack in found[2:]] == [(True, True)]
    buffer.released = lambda: None
    assert buffer.insert(actor.live([GOES_ON], rng)).finished
    waiting = threading.Thread(target=lambda: found.append(buffer.sample(10**9, 60.0)))
    waiting.start()
    buffer.close()
    waiting.join(30.0)
    assert found[-1] is None


def test_that_the_run_is_over_holds_until_it_is_taken_back(tmp_path: Path) -> None:
    buffer = long_run(make_config(), tmp_path, 4)
    buffer.progress(0, goal=buffer.progress(0).agent_steps)
    buffer.progress(0)
    buffer.sample(0, 0.0)
    assert buffer.poll("a").finished
    buffer.progress(0, goal=MAX_COUNT)
    assert not buffer.poll("a").finished


def test_the_chunk_that_reaches_the_goal_tells_it_to_all(tmp_path: Path) -> None:
    buffer = ReplayBuffer(make_config(learning_starts=8, ratio_tolerance=0), tmp_path)
    actor, rng, told = Actor("a", 4), np.random.default_rng(0), []
    buffer.progress(0, goal=16)
    buffer.released = lambda: told.append(buffer.poll("held").finished)
    assert [buffer.insert(actor.live([GOES_ON] * 5, rng)).finished for _ in range(3)] == [False] * 3
    assert told == []
    assert buffer.insert(actor.live([GOES_ON], rng)).finished
    assert told == [True]


def test_statistics_tell_what_each_chunk_was(tmp_path: Path) -> None:
    config = make_config(batch_size=16)
    buffer, actor, rng = ReplayBuffer(config, tmp_path), Actor("a", 4), np.random.default_rng(0)
    chunks = [actor.live([GOES_ON, TERMINATES, GOES_ON], rng) for _ in range(3)]
    buffer.insert(chunks[0])
    buffer.sample(16 * 5, 0.0)  # five updates begun; the weights were those of update 0
    buffer.insert(chunks[1])
    buffer.insert(chunks[0])
    with pytest.raises(MessageError):
        buffer.insert(Actor("b", 4, width=2).live([GOES_ON], rng))
    progress = buffer.progress(0)
    assert (progress.accepted, progress.duplicates, progress.refused) == (2, 1, 1)
    first, second = progress.statistics
    assert (first.index, first.agent_steps, first.steps, first.actor) == (0, 3, 3, "a")
    assert (first.epsilon, first.staleness, second.staleness) == (0.5, 0, 5)
    assert (first.valid, first.matched) == (int(chunks[0].valid.sum()), 3)
    assert first.follows == 2
    assert [(game.score, game.steps) for game in first.games] == [(1.5, 9)]
    assert buffer.progress(1).statistics == (second,)
    assert progress.file_bytes >= 64 * 7_056
    assert progress.resident_bytes > progress.private_bytes > 0
    buffer.close()
    again = ReplayBuffer(config, tmp_path)
    after = again.progress(0)
    assert after.statistics == progress.statistics
    assert (after.accepted, after.duplicates, after.refused) == (2, 1, 1)
    assert again.insert(chunks[1]).status == "duplicate"


def test_a_full_disk_keeps_no_sender_from_an_answer_that_stores_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    buffer, rng, actor = (
        ReplayBuffer(make_config(), tmp_path),
        np.random.default_rng(0),
        Actor("a", 4),
    )
    chunks = [actor.live([GOES_ON] * 5, rng) for _ in range(2)]
    buffer.insert(chunks[0])
    with monkeypatch.context() as full:
        no_room = Mock(side_effect=OSError(errno.ENOSPC, "No space left on device"))
        full.setattr(buffer._store, "_append", no_room)
        assert buffer.insert(chunks[0]).status == "duplicate"
        with pytest.raises(MessageError):
            buffer.insert(Actor("b", 4, width=2).live([GOES_ON], rng))
        with pytest.raises(OSError, match="No space"):  # this one would be lost
            buffer.insert(chunks[1])
    progress = buffer.progress()
    assert (progress.accepted, progress.duplicates, progress.refused) == (1, 1, 1)
    broken = Mock(side_effect=OSError(errno.EIO, "I/O error"))
    monkeypatch.setattr(buffer._store, "_append", broken)
    with pytest.raises(OSError, match="I/O error"):
        buffer.insert(chunks[0])


def test_held_out_states_are_different_and_wholly_seen(tmp_path: Path) -> None:
    buffer, actor = ReplayBuffer(make_config(capacity=200), tmp_path), Actor("a", 4)
    buffer.insert(actor.live([GOES_ON] * 150, np.random.default_rng(5)))
    valid = {moment.stack[-1]: moment.valid for moment in actor.moments}
    expected = {
        moment.stack[-1]
        for moment in actor.moments[:-3]
        if all(valid[number] for number in moment.stack)
    }
    frames, vectors = buffer.held_out(10_000)
    found = [number_of(stack[-1]) for stack in frames]
    assert sorted(found) == sorted(expected)
    assert 0 < len(expected) < 147
    assert vectors.shape == (len(found), 0)
    late = [stack[-1] for stack in buffer.held_out(10_000, newest=40)[0]]
    assert sorted(map(number_of, late)) == sorted(each for each in expected if each > 110)
    few, _ = buffer.held_out(5)
    assert few.shape == (5, 4, 84, 84)


@pytest.mark.parametrize("sampler", ["uniform", "prioritised"])
def test_drawing_while_the_ring_turns_never_mixes_frames(tmp_path: Path, sampler: str) -> None:
    config = make_config(capacity=32, sampler=sampler, n_step=1)
    buffer, actor = ReplayBuffer(config, tmp_path), Actor("0", 4)
    rng = np.random.default_rng(0)
    chunks = [actor.live([GOES_ON] * 4 + [TERMINATES], rng) for _ in range(400)]
    buffer.insert(chunks[0])

    def turn() -> None:
        for chunk in chunks[1:]:
            buffer.insert(chunk)

    writer = threading.Thread(target=turn)
    writer.start()
    rounds = 0
    while writer.is_alive() or rounds < 5:
        batch = buffer.sample(0, 0.0)
        assert batch is not None
        for stack in batch.s_tm1:  # frames of one episode, or one frame repeated
            numbers = [number_of(frame) for frame in stack]
            assert numbers == actor.moments[numbers[-1] - 1].stack
        buffer.update_priorities(batch.ids, np.ones(len(batch.ids), np.float32))
        for stack in buffer.held_out(16)[0]:
            numbers = [number_of(frame) for frame in stack]
            assert numbers == actor.moments[numbers[-1] - 1].stack
        rounds += 1
    writer.join()


def test_a_draw_before_which_all_steps_are_evicted_waits_for_others(tmp_path: Path) -> None:
    config = make_config(capacity=53, n_step=20, batch_size=1)
    buffer, rng = ReplayBuffer(config, tmp_path), np.random.default_rng(0)
    first, *others = (Actor(name, 4) for name in "abc")
    for actor in (first, first, others[0]):
        buffer.insert(actor.live([GOES_ON] * 16, rng))
    assert buffer.progress(0).samplable == 32 - 20
    gather = buffer._gather

    def after_an_insert(*how: Any) -> Any:
        buffer.insert(others[1].live([GOES_ON] * 16, rng))
        return gather(*how)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(buffer, "_gather", after_an_insert)
        assert buffer.sample(0, 0.0) is None
    assert buffer.progress(0).failed == ""
    for _ in range(2):
        buffer.insert(others[1].live([GOES_ON] * 16, rng))
    assert buffer.sample(0, 0.0) is not None
    buffer.close()


def test_held_out_states_are_read_while_others_insert(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A thousand states take a fifth of a second. Whose frames were evicted is chosen anew."""
    buffer, actor = ReplayBuffer(make_config(capacity=64), tmp_path), Actor("a", 4)
    rng = np.random.default_rng(0)
    buffer.insert(actor.live([GOES_ON] * 40, rng))
    take, taken, other = Ring._frames, list[int](), ThreadPoolExecutor(1)

    def slowly(ring: Ring, stacks: NDArray[np.int64]) -> NDArray[np.uint8]:
        taken.append(int(stacks.min()))
        if len(taken) == 1:
            for chunk in (actor.live([GOES_ON] * 40, rng) for _ in range(2)):
                assert other.submit(buffer.insert, chunk).result(PATIENCE).status == "stored"
        return take(ring, stacks)

    monkeypatch.setattr(Ring, "_frames", slowly)
    stacks = [[number_of(frame) for frame in stack] for stack in buffer.held_out(8)[0]]
    assert [len(taken), len(stacks)] == [2, 8]
    assert taken[0] < 40 <= taken[1]
    assert all(stack == actor.moments[stack[-1] - 1].stack for stack in stacks)


def test_priorities_change_what_is_drawn(tmp_path: Path) -> None:
    config = make_config(
        batch_size=512, sampler="prioritised", priority_exponent=1.0, importance_exponent=1.0
    )
    buffer = long_run(config, tmp_path, 1)
    buffer.update_priorities(np.arange(5), np.array([0, 0, 0, 1, 3], np.float32))
    batch = buffer.sample(0, 0.0)
    assert batch is not None
    assert set(batch.ids.tolist()) == {3, 4}
    np.testing.assert_allclose(batch.weights[batch.ids == 4], 1 / 3, rtol=1e-4)
    buffer.close()
    batch = ReplayBuffer(config, tmp_path).sample(0, 0.0)
    assert batch is not None
    assert set(batch.ids.tolist()) == {3, 4}


def test_finite_priorities_look_through_no_chunks(tmp_path: Path) -> None:
    """There are thousands, and draws and inserts wait for the lock meanwhile."""
    buffer = long_run(make_config(sampler="prioritised"), tmp_path, 1)
    buffer._store.index.chunks = None  # type: ignore[assignment]
    buffer.update_priorities(np.arange(5), np.ones(5, np.float32))


@pytest.mark.parametrize("sampler", ["uniform", "prioritised"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_steps_without_a_finite_priority_are_not_drawn_again_and_their_actor_is_named(
    tmp_path: Path, sampler: str, bad: float, caplog: pytest.LogCaptureFixture
) -> None:
    config = make_config(batch_size=512, sampler=sampler, capacity=64)
    buffer, rng = ReplayBuffer(config, tmp_path), np.random.default_rng(0)
    actors = [Actor(name, 4) for name in "abc"]
    for actor in actors:
        buffer.insert(actor.live([GOES_ON] * 9 + [TERMINATES], rng))
    buffer.update_priorities(np.array([0, 18, 0, 14]), np.array([bad, bad, bad, 1], np.float32))
    assert caplog.messages == ["steps 0, 18 of a, b are not drawn again: their loss is not finite"]
    # Nor when a chunk after theirs lets its last steps be looked at once more.
    buffer.insert(actors[1].live([GOES_ON] * 10, rng))
    batch = buffer.sample(0, 0.0)
    assert batch is not None
    assert set(range(37)) - set(batch.ids.tolist()) == {0, 18}
    assert buffer.progress(0).samplable == 35
    buffer.update_priorities(np.array([0]), np.array([bad], np.float32))
    assert len(caplog.messages) == 1
    while buffer.progress(0).accepted < 20:  # the ring turns
        buffer.insert(actors[2].live([GOES_ON] * 10, rng))
    batch = buffer.sample(0, 0.0)
    assert batch is not None
    assert batch.ids.min() > 64
    buffer.update_priorities(batch.ids[:1], np.array([bad], np.float32))
    assert buffer._store._quarantined == {batch.ids[0]}  # those that are gone take no memory


def test_the_journal_stays_short_and_forgets_nothing(tmp_path: Path) -> None:
    config = make_config(capacity=16)
    buffer, actor = ReplayBuffer(config, tmp_path), Actor("a", 4)
    rng = np.random.default_rng(0)
    chunks = [actor.live([GOES_ON], rng) for _ in range(40)]
    buffer.insert(chunks[0])
    for _ in range(1_200):
        buffer.insert(chunks[0])
    for chunk in chunks[1:]:
        buffer.insert(chunk)
    lines = (tmp_path / "journal.jsonl").read_bytes().count(b"\n")
    assert lines < 1_200
    buffer.close()
    buffer = ReplayBuffer(config, tmp_path)
    progress = buffer.progress(0)
    assert (progress.accepted, progress.duplicates, progress.agent_steps) == (40, 1_200, 40)
    assert buffer.insert(chunks[3]).status == "duplicate"


def test_an_insert_does_not_wait_for_the_disk_to_have_what_came_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    buffer = ReplayBuffer(make_config(), tmp_path)
    actor, rng = Actor("0", 4), np.random.default_rng(0)
    waited: dict[str, bool] = {}

    def insert_meanwhile(file: int) -> None:
        insert = threading.Thread(target=buffer.insert, args=(actor.live([GOES_ON], rng),))
        insert.start()
        insert.join(PATIENCE)
        waited[Path(f"/proc/self/fd/{file}").readlink().name] = insert.is_alive()

    monkeypatch.setattr(os, "fdatasync", insert_meanwhile)
    buffer.sync()
    assert not any(waited.values())
    assert {"frames.bin", "journal.jsonl"} <= waited.keys()
    buffer.close()


def test_a_torn_journal_loses_only_what_was_not_acknowledged(tmp_path: Path) -> None:
    config = make_config()
    buffer = long_run(config, tmp_path, 3)
    buffer.close()
    path = tmp_path / "journal.jsonl"
    path.write_bytes(path.read_bytes()[:-20])
    buffer = ReplayBuffer(config, tmp_path)
    assert buffer.progress(0).accepted == 2
    actor, rng = Actor("a", 4), np.random.default_rng(0)
    statuses = [buffer.insert(actor.live([GOES_ON] * 8, rng)).status for _ in range(4)]
    assert statuses == ["duplicate", "duplicate", "stored", "stored"]
    batch = buffer.sample(0, 0.0)
    assert batch is not None
    check_batch(batch, [actor], config)


def test_a_chunk_half_written_over_others_does_not_spoil_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As when the process dies between writing the frames and the journal."""
    config = make_config(capacity=32, batch_size=256)
    buffer, actor = ReplayBuffer(config, tmp_path), Actor("a", 4)
    rng = np.random.default_rng(0)
    for _ in range(4):
        buffer.insert(actor.live([GOES_ON] * 8, rng))
    chunk = actor.live([GOES_ON] * 8, rng)
    with monkeypatch.context() as patch:
        patch.setattr("replay.store.chunk_entry", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            buffer.insert(chunk)
    buffer.close()
    buffer = ReplayBuffer(config, tmp_path)
    batch = buffer.sample(0, 0.0)
    assert batch is not None
    assert check_batch(batch, [actor], config) == set(range(12, 30))
    assert buffer.insert(chunk).status == "stored"


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"capacity": 65}, "capacity 64 instead of 65"),
        ({"frame_stack": 3}, "history 4 instead of 3"),
    ],
)
def test_a_ring_of_other_sizes_is_refused(
    tmp_path: Path, changes: dict[str, int], complaint: str
) -> None:
    long_run(make_config(), tmp_path, 2).close()
    with pytest.raises(InputError, match=complaint):
        ReplayBuffer(make_config(RunConfig, **changes), tmp_path)


def test_a_ring_without_its_frames_is_refused(tmp_path: Path) -> None:
    long_run(make_config(), tmp_path, 2).close()
    (tmp_path / "frames.bin").unlink()
    with pytest.raises(InputError, match="damaged"):
        ReplayBuffer(make_config(), tmp_path)


@pytest.mark.parametrize(
    ("lines", "number"), [("", 1), ('{"ki', 1), ("[]\n", 1), ('HEADER\n{"kind":"odd"}\n', 2)]
)
def test_a_journal_without_its_first_lines_is_refused(
    tmp_path: Path, lines: str, number: int
) -> None:
    long_run(make_config(), tmp_path, 2).close()
    journal = tmp_path / "journal.jsonl"
    header = journal.read_text().splitlines()[0]
    journal.write_text(lines.replace("HEADER", header))
    with pytest.raises(InputError, match=f"damaged in line {number}"):
        ReplayBuffer(make_config(), tmp_path)


def flip(path: Path, place: int) -> None:
    content = bytearray(path.read_bytes())
    content[place] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize("column", ["frames", "rewards", "flags", "vectors", "elapsed"])
def test_damaged_rows_are_reported_and_the_rest_is_used(
    tmp_path: Path, column: str, caplog: pytest.LogCaptureFixture
) -> None:
    config = make_config(VectorConfig, capacity=200, batch_size=2_000)
    actor, rng = Actor("0", 4, 3), np.random.default_rng(0)
    buffer = ReplayBuffer(config, tmp_path)
    endings = [[*[GOES_ON] * 9, end] for end in (TERMINATES, TRUNCATES, GOES_ON, GOES_ON, GOES_ON)]
    for each in endings:
        buffer.insert(actor.live(each, rng))
    expected = buffer.progress(0)
    buffer.close()
    size = (tmp_path / f"{column}.bin").stat().st_size // 200
    # Ids 0 to 9, 10 to 20 with a final frame, 21 to 30, 31 to 40, 41 to 50.
    flip(tmp_path / f"{column}.bin", 35 * size)

    buffer = ReplayBuffer(config, tmp_path)
    assert caplog.messages == [
        f"1 of 5 chunks in {tmp_path} are damaged, or were overwritten while they were copied: "
        "they are not drawn, the rest is used"
    ]
    batch = buffer.sample(0, 0.0)
    assert batch is not None
    check_batch(batch, [actor], config)
    # Of the chunk before, returns of three steps reach in; of the one after, stacks of four.
    assert set(batch.ids.tolist()) == {*range(20), *range(21, 28), *range(44, 48)}
    after = buffer.progress(0)
    assert (after.agent_steps, after.accepted) == (expected.agent_steps, expected.accepted)
    assert after.stored == expected.stored - 10
    buffer.close()


def test_a_ring_that_is_read_anew_tells_how_far_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("common.process.progress.PLAIN_SECONDS", 0.0)
    buffer, actor = ReplayBuffer(make_config(), tmp_path), Actor("a", 4)
    assert capsys.readouterr().err == ""
    rng = np.random.default_rng(0)
    for _ in range(2):
        buffer.insert(actor.live([GOES_ON] * 15 + [TERMINATES], rng))
    buffer.close()
    ReplayBuffer(make_config(), tmp_path).close()
    told = [line.split(" ", 1)[1] for line in capsys.readouterr().err.splitlines()]
    assert [line.split(", 0:00")[0] for line in told] == [
        "checking the replay: 50 %, 1 of 2 chunks",
        "checking the replay: 100 %, 2 of 2 chunks",
    ]


@pytest.mark.parametrize("whole", [0, 1, 3])
def test_ids_of_damaged_chunks_are_not_used_again(tmp_path: Path, whole: int) -> None:
    config = make_config(capacity=40, batch_size=500, sampler="prioritised")
    actor, rng = Actor("0", 4), np.random.default_rng(0)
    endings = [*[GOES_ON] * 9, TERMINATES]
    buffer = ReplayBuffer(config, tmp_path)
    for _ in range(4):
        buffer.insert(actor.live(endings, rng))
    buffer.close()
    for chunk in range(whole, 4):
        flip(tmp_path / "frames.bin", (10 * chunk + 5) * 7_056)
    ReplayBuffer(config, tmp_path).close()
    buffer = ReplayBuffer(config, tmp_path)  # and the restart after knows, too

    for inserted in range(1, 8):
        buffer.insert(actor.live(endings, rng))
        buffer.update_priorities(np.arange(10 * whole, 40), np.full(40 - 10 * whole, np.nan))
        batch = buffer.sample(0, 0.0)
        assert batch is not None
        check_batch(batch, [actor], config)
        newest = range(max(40, 10 * inserted), 40 + 10 * inserted)
        assert set(batch.ids.tolist()) == {*range(10 * inserted, 10 * whole), *newest}
        ring = buffer._store.ring
        assert ring.head - ring.tail <= 40  # what is overwritten is not alive
    buffer.close()


def test_who_claims_to_go_on_after_an_end_has_its_own_frames_before(tmp_path: Path) -> None:
    buffer, rng = ReplayBuffer(make_config(), tmp_path), np.random.default_rng(0)
    buffer.insert(Actor("a", 4).live([GOES_ON, TERMINATES], rng))
    other = Actor("a", 4, first_number=10)
    other.live([GOES_ON] * 3, rng)
    buffer.insert(other.live([GOES_ON] * 4, rng))
    found = buffer._store.ring.states(np.array([2 + 3]))
    assert found is not None
    assert [number_of(frame) for frame in found[0][0]] == [11, 12, 13, 14]
    buffer.close()


def test_a_run_that_goes_on_draws_otherwise_than_at_its_start(tmp_path: Path) -> None:
    actor, rng, drawn = Actor("0", 4), np.random.default_rng(0), []
    for _ in range(3):
        buffer = ReplayBuffer(make_config(), tmp_path)
        drawn.append(buffer._rng.random())
        buffer.insert(actor.live([GOES_ON], rng))
        buffer.close()
    assert len(set(drawn)) == 3


def test_damaged_lines_are_reported_and_the_rest_is_used(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    config = make_config(capacity=40, batch_size=2_000)
    actor, rng = Actor("0", 4), np.random.default_rng(0)
    buffer = ReplayBuffer(config, tmp_path)
    chunks = [actor.live([*[GOES_ON] * 9, TERMINATES], rng) for _ in range(6)]
    for chunk in chunks:
        buffer.insert(chunk)
    buffer.close()
    journal = tmp_path / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    kinds = [json.loads(line)["kind"] for line in lines]
    assert kinds == ["ring", "state", "counts", *["chunk"] * 4, "tail", "chunk", "tail", "chunk"]
    # The second chunk, and that the first two are gone: their slots have others' rows now.
    for lost in (4, 7, 9):
        lines[lost] = lines[lost].replace(b"kind", b"kine")
    journal.write_bytes(b"".join(lines))

    buffer = ReplayBuffer(config, tmp_path)
    assert caplog.messages[0].startswith(f"3 of 11 lines of {journal} are damaged, the first is ")
    batch = buffer.sample(0, 0.0)
    assert batch is not None
    check_batch(batch, [actor], config)
    assert set(batch.ids.tolist()) == set(range(20, 60))
    assert [each.index for each in buffer.progress(0).statistics] == [0, 2, 3, 4, 5]
    assert [each.index for each in buffer.progress(2).statistics] == [2, 3, 4, 5]
    assert buffer.insert(chunks[5]).status == "duplicate"
    buffer.close()


@pytest.mark.parametrize("kept", [5, 6, 7])
def test_a_journal_that_was_cut_short_is_reported_and_the_rest_is_used(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, kept: int
) -> None:
    """As by a copy that was interrupted: a resumed run's journal begins with all that it has."""
    config = make_config()
    long_run(config, tmp_path, 2).close()
    ReplayBuffer(config, tmp_path).close()
    journal = tmp_path / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    kinds = [json.loads(line)["kind"] for line in lines]
    assert kinds == ["ring", "state", "counts", "facts", "facts", "held", "held"]
    journal.write_bytes(b"".join(lines[:kept]))
    buffer = ReplayBuffer(config, tmp_path)
    lost = 7 - kept
    told = f"{journal} was cut short: at least {lost} chunks that it listed are lost, the rest is"
    assert [each.startswith(told) for each in caplog.messages] == [True] * (lost > 0)
    assert len(buffer._store.index.chunks) == kept - 5
    buffer.close()


def test_a_replay_of_a_former_version_is_read_and_gets_checksums(tmp_path: Path) -> None:
    buffer = long_run(make_config(), tmp_path, 3)
    before = buffer.progress(0)
    buffer.close()
    journal = tmp_path / "journal.jsonl"
    former = []
    for line in journal.read_text().splitlines():
        entry = json.loads(line)
        del entry["crc"]
        entry.pop("uuid", None)
        if "placement" in entry:
            entry["placement"] = entry["placement"][:5]
        former.append(json.dumps(entry | ({"format": 1} if "format" in entry else {})))
    journal.write_text("\n".join(former) + "\n")
    buffer = ReplayBuffer(make_config(), tmp_path)
    after = buffer.progress(0)
    assert (after.statistics, after.samplable) == (before.statistics, before.samplable)
    buffer.close()
    header = json.loads(journal.read_text().splitlines()[0])
    assert (header["format"], buffer.run_id[:32]) == (2, header["uuid"])


def test_long_lines_do_not_grow_the_journal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A restart reads it whole, and an actor can claim a game for each step."""
    monkeypatch.setattr("replay.chunk_index._KEPT_GAMES", 100)
    buffer, actor = ReplayBuffer(make_config(capacity=64), tmp_path), Actor("a", 4)
    games, rng = (Game(-123_456.78901234567, 2_000_000_000),) * 50, np.random.default_rng(0)
    for _ in range(150):  # 1.8 kB each
        buffer.insert(dataclasses.replace(actor.live([GOES_ON] * 50, rng), games=games))
    assert (tmp_path / "journal.jsonl").stat().st_size < 80_000
    buffer.close()
    again = ReplayBuffer(make_config(capacity=64), tmp_path).progress(0)
    assert [each.index for each in again.statistics] == [148, 149]


def test_refusals_do_not_grow_the_journal(tmp_path: Path) -> None:
    buffer = long_run(make_config(), tmp_path, 2)
    for _ in range(3_000):
        buffer.refuse()
    assert (tmp_path / "journal.jsonl").read_bytes().count(b"\n") < 1_100
    assert buffer.progress(0).refused == 3_000
    buffer.close()
    buffer.refuse()  # by a request that was under way


def test_a_long_journal_is_rewritten_when_it_has_doubled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("replay.store._SPARE_BYTES", 0)
    buffer, actor = ReplayBuffer(make_config(capacity=300), tmp_path), Actor("a", 4)
    rewrite, sizes, rng = Journal.rewrite, list[int](), np.random.default_rng(0)

    def noted(journal: Journal, entries: Iterable[Entry]) -> None:
        rewrite(journal, entries)
        sizes.append(journal.size)

    monkeypatch.setattr(Journal, "rewrite", noted)
    for _ in range(256):
        buffer.insert(actor.live([GOES_ON], rng))
    assert all(later > 1.9 * size for size, later in pairwise(sizes))
    assert len(sizes) > 4
    buffer.close()


def test_two_processes_cannot_share_a_ring(tmp_path: Path) -> None:
    buffer = long_run(make_config(), tmp_path, 2)
    with pytest.raises(InputError, match="another process"):
        ReplayBuffer(make_config(), tmp_path)
    assert buffer.progress(0).accepted == 2


def test_no_draw_waits_for_a_disk_that_tells_its_figures_late(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    buffer, stat = ReplayBuffer(make_config(), tmp_path), os.stat
    drawing = ThreadPoolExecutor(1)

    def draw_meanwhile(path: Path, **how: bool) -> os.stat_result:
        assert drawing.submit(buffer.sample, 0, 0.0).result(PATIENCE) is None
        return stat(path, **how)

    monkeypatch.setattr(os, "stat", draw_meanwhile)
    assert buffer.progress(0).file_bytes > 0
    drawing.shutdown()
    buffer.close()


def test_no_space_is_said_with_the_bytes_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(file: int, offset: int, size: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("replay.columns.os.posix_fallocate", full)
        with pytest.raises(InputError, match=f"{64 * (7_056 + 7):,} bytes.*No space left"):
            ReplayBuffer(make_config(), tmp_path / "ring")
    assert list(tmp_path.iterdir()) == []


def test_a_start_that_fails_leaves_no_new_ring_and_an_old_one_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, content: bytes) -> None:
        path.write_bytes(content)
        raise OSError(28, "No space left on device")

    for chunks in (0, 2):
        with monkeypatch.context() as patch:
            patch.setattr("replay.journal.write_atomically", full)
            with pytest.raises(InputError, match="No space left"):
                ReplayBuffer(make_config(), tmp_path / "ring")
        assert len(list(tmp_path.iterdir())) == min(chunks, 1)
        buffer = long_run(make_config(), tmp_path / "ring", 2 - chunks)
        assert buffer.progress(0).accepted == 2
        buffer.close()


def test_a_ring_that_cannot_fit_does_not_fill_the_disk_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("replay.columns.os.posix_fallocate", lambda *_: pytest.fail("it tried"))
    with pytest.raises(InputError, match="No space left"):
        ReplayBuffer(make_config(capacity=2**40), tmp_path / "ring")
    assert list(tmp_path.iterdir()) == []


def test_actions_are_those_of_the_runs_game(tmp_path: Path) -> None:
    config = make_config(minimal_actions=True)  # Pong's own
    buffer, rng = ReplayBuffer(config, tmp_path), np.random.default_rng(0)
    actor = Actor("a", frame_stack=4)
    chunk = actor.live([GOES_ON] * 8, rng)
    chunk.actions[:] = 5
    assert buffer.insert(chunk).status == "stored"
    chunk = actor.live([GOES_ON] * 8, rng)
    chunk.actions[:] = [0, 1, 2, 3, 4, 5, 6, 0]
    with pytest.raises(MessageError, match="actions should be less than 6"):
        buffer.insert(chunk)


@pytest.mark.parametrize("fault", ["action", "context", "width", "size"])
def test_chunks_that_do_not_fit_the_run_are_refused(tmp_path: Path, fault: str) -> None:
    buffer, rng = ReplayBuffer(make_config(), tmp_path), np.random.default_rng(0)
    actor = Actor("a", frame_stack=6 if fault == "context" else 4, width=int(fault == "width"))
    actor.live([GOES_ON] * 8, rng)
    chunk = actor.live([GOES_ON] * (65 if fault == "size" else 8), rng)
    if fault == "action":
        chunk.actions[3] = 18
    with pytest.raises(MessageError):
        buffer.insert(chunk)
    assert buffer.progress(0).refused == 1


def test_a_run_has_one_identity_from_its_beginning_to_its_end(tmp_path: Path) -> None:
    def run_id(folder: str, **settings: Any) -> str:
        buffer = ReplayBuffer(make_config(**settings), tmp_path / folder)
        buffer.close()
        return buffer.run_id

    first = run_id("one")
    assert run_id("one") == first
    assert len({first, run_id("two"), run_id("one", discount=0.5)}) == 3
