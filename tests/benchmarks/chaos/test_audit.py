"""The audit finds what a replay has lost, altered, doubled or invented."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.chaos.audit import (
    Audit,
    AuditOfTests,
    RecordedTest,
    audit,
    audit_tests,
    recorded_tests,
)
from benchmarks.chaos.witness import line
from common.errors import InputError
from common.protocol.chunk import Chunk
from common.run.epochs import EpochPhase, EpochRow, EpochTable
from replay.replay_buffer import ReplayBuffer
from tests.replay.replay_reference import GOES_ON, TERMINATES, TRUNCATES, Actor, make_config

CHUNK = 4
CONFIG = make_config(capacity=80)


class Case:
    """A replay of chunks of four steps, and the record of the actor that made them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "replay"
        self.record = folder / "a.record"
        self.record.touch()
        self.buffer = ReplayBuffer(CONFIG, self.folder)
        self.actor = Actor("0", 4)
        self._rng = np.random.default_rng(0)

    def make(self, *endings: int) -> Chunk:
        return self.actor.live(list(endings) or [GOES_ON, GOES_ON, GOES_ON, TERMINATES], self._rng)

    def told(self, what: str, chunk: Chunk) -> None:
        with self.record.open("ab") as file:
            file.write(line(what, chunk))

    def store(self, *endings: int, acknowledged: bool = True) -> Chunk:
        chunk = self.make(*endings)
        self.told("made", chunk)
        self.buffer.insert(chunk)
        if acknowledged:
            self.told("acknowledged", chunk)
        return chunk

    def audit(self) -> Audit:
        return audit(self.folder, [self.record])

    def alter(self, file: str, offset: int) -> None:
        with (self.folder / file).open("r+b") as changed:
            changed.seek(offset)
            found = changed.read(1)[0]
            changed.seek(offset)
            changed.write(bytes([found ^ 1]))


@pytest.fixture
def case(tmp_path: Path) -> Case:
    return Case(tmp_path)


def test_what_is_whole_is_clean_also_without_the_last_acknowledgement(case: Case) -> None:
    for _ in range(5):
        case.store()
    case.store(acknowledged=False)
    found = case.audit()
    assert found == Audit(6, 5, 6, lost=0, duplicated=0, steps=24, unknown_rows=0)
    assert found.clean


def test_frames_at_which_games_were_cut_are_known(case: Case) -> None:
    case.store(GOES_ON, TRUNCATES, GOES_ON, TRUNCATES)
    case.store()
    case.store(TRUNCATES)
    assert case.audit() == Audit(3, 3, 3, lost=0, duplicated=0, steps=9, unknown_rows=0)
    case.alter("frames.bin", 84 * 84 * 5 + 99)  # the second of them, after four steps
    found = case.audit()
    assert (found.lost, found.unknown_rows) == (1, 6)


def test_a_reopened_replay_and_a_torn_record_are_read(case: Case) -> None:
    case.store()
    case.buffer.close()
    case.buffer = ReplayBuffer(CONFIG, case.folder)
    case.store()
    with case.record.open("a") as file:
        file.write("made 1234")
    assert case.audit() == Audit(2, 2, 2, lost=0, duplicated=0, steps=8, unknown_rows=0)


@pytest.mark.parametrize(
    ("file", "offset"),
    [
        ("frames.bin", 84 * 84 * 6 + 99),
        ("actions.bin", 5),
        ("rewards.bin", 4 * 7),
        ("elapsed.bin", 4),
    ],
)
def test_one_bit_is_found(case: Case, file: str, offset: int) -> None:
    for _ in range(3):
        case.store()
    case.alter(file, offset)
    found = case.audit()
    assert (found.stored, found.lost, found.unknown_rows) == (2, 1, CHUNK)
    assert not found.clean


def _lose(case: Case) -> None:
    chunk = case.make()
    case.told("made", chunk)
    case.told("acknowledged", chunk)


def _invent(case: Case) -> None:
    case.buffer.insert(case.make())


def _double(case: Case) -> None:
    chunk = case.store()
    case.buffer.insert(Chunk.decode(Chunk(**{**vars(chunk), "sequence": 99}).encode()))


@pytest.mark.parametrize(
    ("harm", "counts"),
    [(_lose, (1, 0, 0)), (_invent, (0, 0, CHUNK)), (_double, (0, 1, 0))],
)
def test_harm_is_counted(
    case: Case, harm: Callable[[Case], None], counts: tuple[int, int, int]
) -> None:
    case.store()
    harm(case)
    case.store()
    found = case.audit()
    assert (found.lost, found.duplicated, found.unknown_rows) == counts
    assert not found.clean


def test_older_frames_before_a_chunk_whose_predecessor_is_missing_are_known(case: Case) -> None:
    case.store()
    case.actor.live([GOES_ON] * 4, np.random.default_rng(1))  # never sent
    case.store()
    found = case.audit()
    assert found.clean
    assert found.steps == 2 * CHUNK


def test_a_ring_that_has_wrapped_is_refused(case: Case) -> None:
    for _ in range(21):
        case.store()
    with pytest.raises(InputError, match="84 steps do not fit"):
        case.audit()


def _epoch(number: int, phase: EpochPhase, steps: int) -> EpochRow:
    return EpochRow.of_games(
        [1.0],
        epoch=number, phase=phase, steps=steps, epoch_time=1.0,
        last_exploration_rate=0.1, total_train_steps=100, replay_memory_count=100,
        meanq=None, meancost=None, weight_updates=9, total_time=10.0 + number,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([], (0, 0, 0)),
        ([(1, "train", 10), (1, "test", 120), (2, "train", 10), (2, "test", 199)], (2, 0, 0)),
        ([(1, "train", 10), (1, "test", 120), (2, "test", 120), (1, "test", 120)], (2, 1, 0)),
        ([(1, "test", 119), (2, "test", 120), (3, "test", 0)], (3, 0, 2)),
    ],
    ids=["none", "whole", "twice", "short"],
)
def test_tests_are_counted_once_and_whole(
    tmp_path: Path, rows: list[tuple[int, EpochPhase, int]], expected: tuple[int, int, int]
) -> None:
    table = EpochTable(tmp_path / "epochs.csv")
    for row in rows:
        table.append(_epoch(*row))
    tested, repeated, short = expected
    found = audit_tests(tmp_path / "epochs.csv", 120)
    assert found == AuditOfTests(tested, repeated, short)
    assert found.clean is (repeated == short == 0)


def test_a_row_that_is_being_written_is_no_test_yet(tmp_path: Path) -> None:
    file = tmp_path / "epochs.csv"
    for number in (1, 2):
        EpochTable(file).append(_epoch(number, "test", 120))
    file.write_text(file.read_text().rstrip("\n"))
    assert recorded_tests(file) == [RecordedTest(1, 120, 11.0)]
