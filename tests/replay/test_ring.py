"""States, returns and discounts, by hand; numbers of frames stand for the frames."""

from pathlib import Path

import numpy as np
import pytest

from common.protocol.chunk import Chunk
from common.settings.conditions import PlayConfig
from common.settings.config import LearningConfig, RunConfig
from replay.columns import Columns
from replay.ring import Placement, Ring
from tests.replay.replay_reference import (
    GOES_ON,
    TERMINATES,
    TRUNCATES,
    Actor,
    chunk_of,
    number_of,
)

RNG = np.random.default_rng(0)


def make_ring(folder: Path, n_step: int = 1, clip: bool = False, frame_stack: int = 4) -> Ring:
    learning = LearningConfig(n_step=n_step, discount=0.5, clip_rewards=clip)
    config = RunConfig(play=PlayConfig(frame_stack=frame_stack), learning=learning)
    return Ring(Columns(folder, 40, 0), config)


def put(ring: Ring, chunk: Chunk, before: Placement | None = None) -> Placement:
    context, previous = (len(chunk.context), -1) if before is None else (0, before.last)
    place = Placement(ring.head, context, len(chunk), len(chunk.final_frames), previous)
    place = ring.write(place, chunk)
    assert ring.is_whole(place)
    ring.link(place)
    ring.head = place.end
    if before is not None:
        ring.join(before, place)
    return place


def states(ring: Ring, *ids: int) -> list[list[int]]:
    found = ring.states(np.array(ids))
    assert found is not None
    return [[number_of(frame) for frame in stack] for stack in found[0]]


def test_the_first_frame_is_repeated_at_an_episodes_start(tmp_path: Path) -> None:
    ring = make_ring(tmp_path)
    place = put(ring, Actor("a", 4).live([GOES_ON] * 5, RNG))
    assert states(ring, *range(place.first, place.last + 1)) == [
        [1, 1, 1, 1],
        [1, 1, 1, 2],
        [1, 1, 2, 3],
        [1, 2, 3, 4],
        [2, 3, 4, 5],
    ]


def test_stacks_do_not_reach_into_the_episode_before(tmp_path: Path) -> None:
    ring = make_ring(tmp_path)
    place = put(ring, Actor("a", 4).live([GOES_ON, TERMINATES, GOES_ON, GOES_ON], RNG))
    assert states(ring, place.first + 2, place.first + 3) == [[3, 3, 3, 3], [3, 3, 3, 4]]


@pytest.mark.parametrize("end", [TERMINATES, TRUNCATES])
def test_an_actor_that_claims_to_go_on_after_an_end_changes_no_earlier_step(
    tmp_path: Path, end: int
) -> None:
    ring = make_ring(tmp_path)
    ended = put(ring, Actor("a", 4).live([GOES_ON, GOES_ON, end], RNG))
    other = Actor("b", 4)
    other.live([GOES_ON] * 3, RNG)
    claimed = put(ring, other.live([GOES_ON] * 3, RNG))
    assert claimed.context
    last, weights = np.array([ended.last]), np.ones(1, np.float32)
    before = ring.read(last, weights)
    ring.join(ended, claimed)
    after = ring.read(last, weights)
    assert before is not None
    assert after is not None
    np.testing.assert_array_equal(after.s_t, before.s_t)
    assert after.discount_t == before.discount_t


def test_stacks_cross_chunks_by_shared_frames_or_by_context(tmp_path: Path) -> None:
    actor = Actor("a", 4)
    one, two, lost, four = (actor.live([GOES_ON] * 3, RNG) for _ in range(4))
    del lost
    ring = make_ring(tmp_path)
    before = put(ring, one)
    shared = put(ring, two, before)
    alone = put(ring, four)
    assert (shared.end - shared.base, alone.end - alone.base) == (3, 6)
    assert states(ring, shared.first, shared.last) == [[1, 2, 3, 4], [3, 4, 5, 6]]
    assert states(ring, alone.first, alone.last) == [[7, 8, 9, 10], [9, 10, 11, 12]]


def test_a_short_context_is_the_episodes_beginning(tmp_path: Path) -> None:
    actor = Actor("a", 4)
    actor.live([GOES_ON], RNG)
    ring = make_ring(tmp_path)
    place = put(ring, actor.live([GOES_ON, GOES_ON], RNG))
    assert states(ring, place.first, place.last) == [[1, 1, 1, 2], [1, 1, 2, 3]]


def with_rewards(
    endings: list[int], rewards: list[float], elapsed: list[int] | None = None
) -> Chunk:
    actor = Actor("a", 4)
    actor.live(endings, RNG)
    for at, moment in enumerate(actor.moments):
        moment.reward, moment.elapsed = rewards[at], elapsed[at] if elapsed else 1
    actor.sequence = 0
    return chunk_of(actor, [], actor.moments)


@pytest.mark.parametrize(
    ("n_step", "step", "reward", "discount", "after"),
    [
        (1, 0, 1.0, 0.5, [1, 1, 1, 2]),
        (3, 0, 1 + 0.5 * 2 + 0.25 * 4, 0.125, [1, 2, 3, 4]),
        (3, 1, 2 + 0.5 * 4 + 0.25 * 8, 0.125, [2, 3, 4, 5]),
    ],
)
def test_returns_of_an_episode_that_goes_on(
    tmp_path: Path, n_step: int, step: int, reward: float, discount: float, after: list[int]
) -> None:
    ring = make_ring(tmp_path, n_step)
    place = put(ring, with_rewards([GOES_ON] * 5, [1, 2, 4, 8, 16]))
    batch = ring.read(np.array([place.first + step]), np.ones(1, np.float32))
    assert batch is not None
    assert batch.r_t.tolist() == [reward]
    assert batch.discount_t.tolist() == [discount]
    assert [number_of(frame) for frame in batch.s_t[0]] == after


def test_a_return_ends_with_its_episode_and_bootstraps_from_nothing(tmp_path: Path) -> None:
    ring = make_ring(tmp_path, n_step=3)
    place = put(ring, with_rewards([GOES_ON, TERMINATES, GOES_ON], [1, 2, 100]))
    ids = np.array([place.first, place.first + 1])
    batch = ring.read(ids, np.ones(2, np.float32))
    assert batch is not None
    assert batch.r_t.tolist() == [1 + 0.5 * 2, 2]
    assert batch.discount_t.tolist() == [0, 0]


def test_a_truncated_episode_bootstraps_from_its_true_final_frame(tmp_path: Path) -> None:
    ring = make_ring(tmp_path, n_step=3)
    place = put(ring, with_rewards([GOES_ON, TRUNCATES, GOES_ON], [1, 2, 100]))
    ids = np.array([place.first, place.first + 1])
    batch = ring.read(ids, np.ones(2, np.float32))
    assert batch is not None
    assert batch.r_t.tolist() == [1 + 0.5 * 2, 2]
    assert batch.discount_t.tolist() == [0.25, 0.5]  # two steps, one step
    after = [[number_of(frame) for frame in stack] for stack in batch.s_t]
    assert after == [[1, 1, 2, 3], [1, 1, 2, 3]]  # 3 is the final frame; 4 begins the next episode


def test_the_discount_follows_the_agent_steps_that_passed(tmp_path: Path) -> None:
    ring = make_ring(tmp_path, n_step=3)
    place = put(ring, with_rewards([GOES_ON] * 4, [1, 2, 4, 8], elapsed=[2, 1, 3, 1]))
    batch = ring.read(np.array([place.first]), np.ones(1, np.float32))
    assert batch is not None
    # the second reward comes after 2 agent steps, the third after 3, the state after 6
    assert batch.r_t.tolist() == [1 + 2 * 0.5**2 + 4 * 0.5**3]
    assert batch.discount_t.tolist() == [0.5**6]


def test_each_reward_is_clipped_before_it_is_summed(tmp_path: Path) -> None:
    ring = make_ring(tmp_path, n_step=2, clip=True)
    place = put(ring, with_rewards([GOES_ON] * 4, [-7, 0.5, 9, 0]))
    batch = ring.read(np.array([place.first, place.first + 1]), np.ones(2, np.float32))
    assert batch is not None
    assert batch.r_t.tolist() == [-1 + 0.5 * 0.5, 0.5 + 0.5 * 1]


@pytest.mark.parametrize("block", [3, 65_536])
def test_steps_are_complete_when_their_return_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    monkeypatch.setattr("replay.ring._BLOCK", block)
    ring = make_ring(tmp_path, n_step=2)
    place = put(ring, with_rewards([GOES_ON, TRUNCATES, GOES_ON, GOES_ON, GOES_ON], [0] * 5))
    everything = np.arange(place.base, place.end)
    # The fourth lacks the state two steps on, the fifth too; the last id is the final frame.
    assert ring.is_complete(everything).tolist() == [True, True, True, False, False, False]


def test_reading_what_was_evicted_meanwhile_is_noticed(tmp_path: Path) -> None:
    ring = make_ring(tmp_path)
    place = put(ring, with_rewards([GOES_ON] * 6, [0] * 6))
    ids = np.array([place.first + 4])  # stacked from the frames of steps 1 to 4
    ring.tail = place.first + 1
    assert ring.read(ids, np.ones(1, np.float32)) is not None
    ring.tail = place.first + 2
    assert ring.read(ids, np.ones(1, np.float32)) is None
