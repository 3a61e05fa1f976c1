import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.checked import build
from common.protocol.chunk import Game
from common.settings.config import MAX_WINDOW
from replay.chunk_index import ChunkIndex, ChunkKey, Received, chunk_entry, tail_entry
from replay.chunk_statistics import MAX_STATISTICS, ChunkStatistics, ReplayProgress
from replay.ring import Placement


@given(st.lists(st.integers(0, 40), max_size=60))
def test_received_remembers_exactly_what_came(sequences: list[int]) -> None:
    received, expected = Received(), set[int]()
    for sequence in sequences:
        assert (sequence in received) == (sequence in expected)
        if sequence not in expected:
            received.add(sequence)
            expected.add(sequence)
    assert {number for number in range(50) if number in received} == expected


@pytest.mark.parametrize("first", [(), (1_000,)])  # the second opens a gap, which the rest splits
def test_gaps_are_bounded(first: tuple[int, ...]) -> None:
    received = Received()
    for sequence in (*first, *range(1, 1_000, 2)):
        received.add(sequence)
    assert len(received.gaps) == 64
    assert 998 not in received
    assert 0 in received  # given up as lost


def test_no_id_below_the_tail_is_used_again() -> None:
    """Where the chunks' own lines are lost."""
    index = ChunkIndex()
    index.apply(json.loads(json.dumps(tail_entry(50))))
    assert (index.tail, index.head) == (50, 50)


def test_no_chunk_of_a_window_is_given_up() -> None:
    """It would be acknowledged as one that came before."""
    received, window = Received(), range(0, 2 * MAX_WINDOW, 2)
    for sequence in window:
        received.add(sequence + 1)
    assert not any(sequence in received for sequence in window)


def statistics(index: int, **others: object) -> ChunkStatistics:
    values: dict[str, object] = {
        "index": index,
        "agent_steps": 4 * (index + 1),
        "steps": 4,
        "actor": "a",
        "epsilon": 0.25,
        "weights_version": 3,
        "staleness": 2,
        "valid": 4,
        "matched": 1,
        "games": (Game(-21.0, 900),),
        "incarnation": 1,
        "follows": 3,
        "curriculum_steps": 2,
    }
    return ChunkStatistics(**(values | others))  # type: ignore[arg-type]


def filled(count: int) -> tuple[ChunkIndex, list[str]]:
    chunks, lines = ChunkIndex(), []
    for index in range(count):
        told = ChunkKey("a", 1, 0, index), Placement(4 * index, 0, 4, 0, -1), statistics(index)
        lines.append(json.dumps(chunk_entry(*told)))
        chunks.accept(*told)
    return chunks, lines


def same(one: ChunkIndex, other: ChunkIndex) -> bool:
    return list(one.entries()) == list(other.entries()) and one.stored == other.stored


def test_streams_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Or whoever invents a stream for each chunk lets memory and journal grow without end."""
    monkeypatch.setattr("replay.chunk_index._MAX_STREAMS", 3)
    chunks = ChunkIndex()
    keys = [ChunkKey("a", start, 0, 0) for start in (1, 2, 3)]
    keys += [keys[0]._replace(sequence=1), *(ChunkKey("a", start, 0, 0) for start in (4, 5))]
    for index, key in enumerate(keys):
        chunks.accept(key, Placement(4 * index, 0, 4, 0, -1), statistics(index))
    assert [stream[:2] for stream in next(chunks.entries())["received"]] == [
        ["a", 1], ["a", 4], ["a", 5],
    ]  # fmt: skip
    assert all(map(chunks.has_received, keys))  # their chunks are in the ring
    chunks.evict(4 * len(keys))
    assert [key.incarnation for key in keys if chunks.has_received(key)] == [1, 1, 4, 5]


def test_entries_make_the_index_again() -> None:
    chunks, lines = filled(5)
    chunks.evict(8)
    chunks.refused = 3
    again = ChunkIndex()
    for line in [*lines, json.dumps(tail_entry(8)), json.dumps(chunks.counts_entry())]:
        again.apply(json.loads(line))
    assert same(chunks, again)
    compacted = ChunkIndex()
    for entry in chunks.entries():
        compacted.apply(json.loads(json.dumps(entry)))
    assert same(chunks, compacted)
    assert compacted.agent_steps == 20
    assert compacted.has_received(ChunkKey("a", 1, 0, 0))
    assert not compacted.has_received(ChunkKey("a", 1, 0, 5))
    assert not compacted.has_received(ChunkKey("a", 2, 0, 0))


@pytest.mark.parametrize(
    "changed",
    [
        {"tail": "x"},
        {"head": None},
        {"head": 2**63},
        {"agent_steps": 1.5},
        {"accepted": True},
        {"received": [["a", 1, 0, "x", []]]},
        {"received": [["a", 1, 0, 4, [[1, 2, 3]]]]},
        {"received": [["a", 1, 0, 4]]},
        {"kind": "tail", "tail": -1},
        {"kind": "counts", "duplicates": 0, "refused": "x"},
        {"kind": "unheard of"},
    ],
)
def test_an_entry_of_another_form_is_refused(changed: dict[str, Any]) -> None:
    """Lines of former journals have no checksum, so anything may be in them."""
    state, *_ = filled(2)[0].entries()
    entry = json.loads(json.dumps({**state, **changed}))
    with pytest.raises((KeyError, TypeError, ValueError)):
        ChunkIndex().apply(entry)


def test_a_journal_from_before_the_head_was_kept_is_read() -> None:
    state, *_ = filled(2)[0].entries()
    del state["head"]
    index = ChunkIndex()
    index.apply({**state, "tail": 5, "crc": 1})
    assert (index.tail, index.head, index.accepted) == (5, 5, 2)


def test_statistics_come_in_portions() -> None:
    chunks, _ = filled(MAX_STATISTICS + 10)
    shard = chunks.statistics_since(4)
    assert [each.index for each in shard] == list(range(4, MAX_STATISTICS + 4))
    rest = chunks.statistics_since(shard[-1].index + 1)
    assert [each.index for each in rest] == list(range(MAX_STATISTICS + 4, MAX_STATISTICS + 10))
    assert chunks.statistics_since(MAX_STATISTICS + 10) == ()
    assert ChunkIndex().statistics_since(0) == ()


def test_statistics_are_bounded_by_their_games_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Or an actor that claims a game for each step fills the replay's memory with them."""
    monkeypatch.setattr("replay.chunk_index._KEPT_STATISTICS", 6)
    monkeypatch.setattr("replay.chunk_index._KEPT_GAMES", 20)
    chunks, lines = ChunkIndex(), []
    games = [1, 1, 1, 1, 1, 1, 1, 9, 9, 0, 2, 1]
    kept = []
    for index, count in enumerate(games):
        told = statistics(index, games=(Game(0.0, 1),) * count)
        key, place = ChunkKey("a", 1, 0, index), Placement(4 * index, 0, 4, 0, -1)
        lines.append(json.dumps(chunk_entry(key, place, told)))
        chunks.accept(key, place, told)
        kept.append([each.index for each in chunks.statistics])
    assert kept[5:] == [
        [0, 1, 2, 3, 4, 5], [1, 2, 3, 4, 5, 6], [2, 3, 4, 5, 6, 7], [5, 6, 7, 8],
        [5, 6, 7, 8, 9], [7, 8, 9, 10], [8, 9, 10, 11],
    ]  # fmt: skip
    again, compacted = ChunkIndex(), ChunkIndex()
    for line in lines:
        again.apply(json.loads(line))
    assert same(chunks, again)
    for entry in chunks.entries():
        compacted.apply(json.loads(json.dumps(entry)))
    assert same(chunks, compacted)
    compacted.apply({"kind": "facts", "facts": statistics(12, games=(Game(0.0, 1),) * 12)})
    assert [each.index for each in compacted.statistics] == [9, 10, 11, 12]


def test_a_learner_can_be_told_of_whatever_actors_say_they_played() -> None:
    """A message holds so many values, and a chunk may have as many games as steps."""
    chunks, seen = ChunkIndex(), list[ChunkStatistics]()
    expected = [statistics(index, games=(Game(0.0, 1),) * 1_024) for index in range(60)]
    for index, each in enumerate(expected):
        chunks.accept(ChunkKey("a", 1, 0, index), Placement(4 * index, 0, 4, 0, -1), each)
    while portion := chunks.statistics_since(len(seen)):
        told = ReplayProgress(0, 0, 0, 60, 0, 0, False, 0, 0, 0, portion)
        seen += ReplayProgress.decode(told.encode()).statistics
    assert seen == expected


def test_steps_beside_a_chunk_cross_chunks_but_no_gap() -> None:
    chunks, _ = filled(4)
    key = ChunkKey("a", 1, 0, 2)
    assert chunks.steps_beside(key, before=6, after=3) == {2, 3, 4, 5, 6, 7, 12, 13, 14}
    chunks.evict(4)
    assert chunks.steps_beside(key, before=6, after=9) == {4, 5, 6, 7, 12, 13, 14, 15}


def test_a_journal_from_before_incarnations_were_kept_is_read() -> None:
    told = json.loads(json.dumps(statistics(0)))
    assert build(ChunkStatistics, told) == statistics(0)
    assert build(ChunkStatistics, told[:-4]) == statistics(
        0, incarnation=0, follows=0, curriculum_steps=0, stream=0
    )
