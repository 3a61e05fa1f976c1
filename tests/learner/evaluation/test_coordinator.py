"""Tests are handed out, shared, taken back from the lost, and counted once."""

import errno
import json
import os
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import pytest

from common.errors import MessageError
from common.protocol.chunk import Game
from common.protocol.evaluation import EvaluationJob, EvaluationReport
from common.regular_file import read_file
from common.settings.config import ProtocolConfig
from learner.evaluation import snapshots
from learner.evaluation.coordinator import (
    ABSENCE,
    MAX_SILENCE,
    MAX_WAITING,
    NEWCOMER,
    EpochTest,
    EvaluationCoordinator,
)
from learner.evaluation.snapshots import Snapshots

PROTOCOL = replace(ProtocolConfig(), test_steps=100, test_epsilon=0.05)


class Place:
    """A coordinator, who is present, and the time."""

    def __init__(self, folder: Path, *present: str, keep: bool = False) -> None:
        self.present = set(present)
        self.now = 1_000.0
        self.coordinator = EvaluationCoordinator(
            Snapshots(folder, keep=keep),
            PROTOCOL,
            lambda: self.present,
            lambda: self.now - 987.5,
            lambda: self.now,
        )

    def ask(self, name: str) -> EvaluationJob:
        return self.coordinator.give_job(name)

    def report(self, name: str, epoch: int, steps: int, scores: list[float], done: bool) -> bool:
        """Whether the report is taken."""
        games = tuple(Game(score, 10) for score in scores)
        try:
            self.coordinator.take_report(EvaluationReport(name, epoch, steps, games, done))
        except MessageError:
            return False
        return True


def epoch_test(epoch: int) -> EpochTest:
    return EpochTest(
        epoch=epoch,
        weight_updates=epoch * 10,
        total_train_steps=epoch * 40,
        replay_memory_count=epoch * 30,
        meanq=0.5,
        remaining=PROTOCOL.test_steps,
    )


def test_one_evaluator_plays_a_whole_test(tmp_path: Path) -> None:
    tests = Place(tmp_path, "e")
    coordinator = tests.coordinator
    assert tests.ask("e").kind == "wait"
    coordinator.add(epoch_test(1), b"weights of 1")

    assert tests.ask("e") == EvaluationJob("test", 1, 100, 0.05, b"weights of 1")
    assert tests.report("e", 1, 60, [-3.0], done=False)
    assert coordinator.take_finished() is None
    assert coordinator.steps_left == 40
    assert tests.report("e", 1, 50, [5.0], done=True)

    done = coordinator.take_finished()
    assert done is not None
    assert (done.epoch, done.steps, done.scores, done.began) == (1, 110, [-3.0, 5.0], 12.5)
    assert coordinator.pending == 0
    assert tests.ask("e").kind == "wait"
    coordinator.finish()
    assert tests.ask("e").kind == "finished"


def test_two_evaluators_share_a_test(tmp_path: Path) -> None:
    tests = Place(tmp_path, "e", "f")
    tests.coordinator.add(epoch_test(1), b"w")
    tests.coordinator.add(epoch_test(2), b"v")
    assert tests.ask("e").steps == 50
    tests.now += 1
    assert tests.ask("f").steps == 50
    assert tests.report("e", 1, 50, [1.0], done=True)
    assert tests.coordinator.take_finished() is None
    assert tests.ask("e").epoch == 2
    assert tests.report("f", 1, 55, [2.0], done=True)
    done = tests.coordinator.take_finished()
    assert done is not None
    assert (done.steps, sorted(done.scores), done.began) == (105, [1.0, 2.0], 12.5)


def test_steps_played_beyond_a_test_do_not_count_for_the_next(tmp_path: Path) -> None:
    tests = Place(tmp_path, "e")
    for epoch in (1, 2):
        tests.coordinator.add(epoch_test(epoch), b"w")
    tests.ask("e")
    assert tests.report("e", 1, 130, [1.0], done=False)
    assert tests.coordinator.steps_left == 100


def test_a_test_whose_snapshot_was_removed_holds_up_no_other(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    tests = Place(tmp_path, "e", "f")
    for epoch in (1, 2):
        tests.coordinator.add(epoch_test(epoch), b"w")
    assert tests.ask("e").epoch == 1
    tests.coordinator.snapshots.file(1).unlink()
    assert tests.ask("f").kind == "wait"
    (told,) = caplog.messages
    assert told == "epoch 1 stays untested: its snapshot is missing"
    assert not tests.report("e", 1, 50, [1.0], done=True)
    assert (tests.ask("f").epoch, tests.coordinator.pending) == (2, 1)


def test_a_test_whose_snapshot_is_damaged_holds_up_no_other(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    tests = Place(tmp_path, "e")
    for epoch in (1, 2):
        tests.coordinator.add(epoch_test(epoch), b"weights")
    file = tests.coordinator.snapshots.file(1)
    file.write_bytes(b"weighty")
    assert tests.ask("e").kind == "wait"
    assert caplog.messages == ["epoch 1 stays untested: its snapshot is damaged"]
    assert tests.ask("e").epoch == 2
    assert file.exists(), "a checkpoint may name it"
    tests.coordinator.sweep()
    assert not file.exists()


def test_a_snapshot_that_cannot_be_read_for_a_while_is_tested_later(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    tests = Place(tmp_path, "e", "f")
    coordinator = tests.coordinator
    coordinator.add(epoch_test(1), b"weights")
    assert tests.ask("f").steps == 50

    def read_some(path: Path) -> bytes:
        if path == coordinator.snapshots.file(1):
            raise OSError(errno.EIO, "Input/output error")
        return read_file(path)

    with monkeypatch.context() as patched:
        patched.setattr(snapshots, "read_file", read_some)
        assert tests.ask("e").kind == "wait"
        coordinator.add(epoch_test(2), b"others")
        assert tests.ask("e").epoch == 2, "it holds up no other test"
        assert tests.report("e", 2, 50, [1.0], done=True)
        assert tests.ask("e").epoch == 2
        assert tests.report("e", 2, 50, [1.0], done=True)
        assert tests.ask("e").kind == "wait"
        coordinator.settle(replace(epoch_test(1), scores=[1.0]), None)
        coordinator.sweep()
    assert caplog.messages == [
        "the snapshot of epoch 1 cannot be read (Input/output error): its test waits until it can",
        "the weights of epoch 1, the best so far, are not kept: their snapshot cannot be read now, "
        "and stays (Input/output error)",
    ]
    assert (tests.ask("e").steps, tests.ask("e").weights) == (50, b"weights")
    assert tests.report("f", 1, 50, [1.0], done=True)
    assert tests.report("e", 1, 50, [1.0], done=True)
    assert [coordinator.take_finished() is not None for _ in range(3)] == [True, True, False]


def test_an_epoch_that_was_unreadable_once_has_its_turn_and_a_second_failure_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    tests = Place(tmp_path, "e")
    tests.coordinator.add(epoch_test(1), b"weights")

    def refuse(path: Path) -> bytes:
        raise OSError(errno.EIO, "Input/output error")

    for times in (1, 2):
        with monkeypatch.context() as patched:
            patched.setattr(snapshots, "read_file", refuse)
            for _ in range(2):
                assert tests.ask("e").kind == "wait"
        assert len(caplog.messages) == times
        assert tests.ask("e").epoch == 1
    tests.coordinator.add(epoch_test(2), b"others")
    assert tests.ask("e").epoch == 1, "it is the oldest"


def test_damaged_weights_are_not_kept_as_the_best(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    coordinator = Place(tmp_path).coordinator
    test = replace(epoch_test(1), scores=[1.0])
    coordinator.add(test, b"weights")
    coordinator.snapshots.file(1).write_bytes(b"weighty")
    coordinator.settle(test, None)
    assert caplog.messages[0].endswith("are not kept: their snapshot is damaged")
    assert not coordinator.snapshots.best.exists()


def test_a_test_of_a_former_versions_checkpoint_has_no_checksum(tmp_path: Path) -> None:
    tests = Place(tmp_path, "e")
    tests.coordinator.add(epoch_test(1), b"weights")
    (state,) = tests.coordinator.state()
    assert state.pop("checksum") is not None
    again = Place(tmp_path, "e")
    assert again.coordinator.restore([state]) == []
    assert again.ask("e").weights == b"weights"


def test_tests_that_evaluators_do_not_keep_up_with_wait_and_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    tests = Place(tmp_path, "e")
    tests.coordinator.add(epoch_test(1), b"w")
    assert tests.ask("e").epoch == 1
    for epoch in range(2, MAX_WAITING + 2):
        tests.coordinator.add(epoch_test(epoch), b"w")
    assert not caplog.messages
    tests.coordinator.add(epoch_test(MAX_WAITING + 2), b"w")
    (told,) = caplog.messages
    assert told.startswith(f"{MAX_WAITING + 1} tests wait for evaluators, which are slower than")
    assert tests.coordinator.pending == MAX_WAITING + 2
    for epoch in range(MAX_WAITING + 3, 3 * MAX_WAITING + 4):
        tests.coordinator.add(epoch_test(epoch), b"w")
    assert len(caplog.messages) == 2, "told again where the backlog has doubled"
    assert caplog.messages[1].startswith(f"{2 * MAX_WAITING + 3} tests wait")


def test_a_missing_snapshot_takes_no_other_test_from_its_evaluator(tmp_path: Path) -> None:
    tests = Place(tmp_path, "e", "f", "g")
    for epoch in (1, 2):
        tests.coordinator.add(epoch_test(epoch), b"w")
    played = {tests.ask(name).epoch for name in "efg"}
    assert played == {1}
    tests.coordinator.snapshots.file(2).unlink()
    tests.present |= {"h"}
    assert tests.ask("h").kind == "wait"
    assert all(tests.report(name, 1, 34, [1.0], done=True) for name in "efg")
    done = tests.coordinator.take_finished()
    assert done is not None
    assert (done.epoch, done.steps) == (1, 102)
    assert tests.coordinator.pending == 0


def test_while_a_test_is_pending_nobody_is_sent_home(tmp_path: Path) -> None:
    tests = Place(tmp_path, "e", "f")
    tests.coordinator.add(epoch_test(1), b"w")
    tests.coordinator.finish()
    assert [tests.ask(name).kind for name in ("e", "f", "g")] == ["test", "test", "wait"]


def test_where_nobody_tests_only_the_newest_wait_and_the_others_files_go(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tests = Place(tmp_path, "e")
    coordinator = tests.coordinator
    coordinator.add(epoch_test(1), b"1")
    assert tests.ask("e").epoch == 1
    tests.present = set()  # but what it was given is still its own
    tests.now += ABSENCE + 1
    for epoch in range(2, 9):
        coordinator.add(epoch_test(epoch), b"w")
    assert sorted(test["epoch"] for test in coordinator.state()) == [1, 5, 6, 7, 8]
    assert len(list(tmp_path.iterdir())) == 8  # until a checkpoint needs them no more

    def refused(path: Path, *, missing_ok: bool = False) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    with monkeypatch.context() as patched:
        patched.setattr(Path, "unlink", refused)
        with pytest.raises(OSError, match="Read-only"):
            coordinator.sweep()
    coordinator.sweep()
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        f"epoch-{epoch:04d}.safetensors" for epoch in (1, 5, 6, 7, 8)
    ]
    tests.present = {"e"}
    for epoch in (9, 10):
        coordinator.add(epoch_test(epoch), b"w")
    assert coordinator.pending == 7


def test_an_evaluator_that_is_away_for_a_moment_costs_no_test(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    tests = Place(tmp_path, "e")
    coordinator = tests.coordinator
    for epoch in range(1, 9):
        coordinator.add(epoch_test(epoch), b"w")
    assert tests.ask("e").epoch == 1
    assert tests.report("e", 1, 60, [1.0], done=False)
    caplog.clear()
    tests.present = set()
    tests.now += 6.0
    assert coordinator.take_finished() is None  # it takes back what is left of the first test
    tests.now += ABSENCE - 7.0
    coordinator.add(epoch_test(9), b"w")
    assert coordinator.pending == 9
    assert not caplog.messages
    tests.now += 2.0
    coordinator.add(epoch_test(10), b"w")
    # The first test has begun, and so it is played to its end by the next evaluator.
    assert sorted(test["epoch"] for test in coordinator.state()) == [1, 7, 8, 9, 10]
    (told,) = caplog.messages
    assert told.startswith("epochs up to 6 stay untested, because there is no evaluator: ")
    tests.present = {"f"}
    assert (tests.ask("f").epoch, tests.ask("g").epoch) == (1, 7)


def test_after_a_restart_evaluators_have_time_to_come_back(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    before = Place(tmp_path, "e")
    for epoch in range(1, 9):
        before.coordinator.add(epoch_test(epoch), b"w")
    again = Place(tmp_path)
    assert again.coordinator.restore(before.coordinator.state()) == []
    caplog.clear()
    again.now += 3.0
    again.coordinator.add(epoch_test(9), b"w")
    assert (again.coordinator.pending, caplog.messages) == (9, [])
    again.now += ABSENCE
    for epoch in (10, 11):
        again.coordinator.add(epoch_test(epoch), b"w")
    assert sorted(test["epoch"] for test in again.coordinator.state()) == [8, 9, 10, 11]
    (told,) = caplog.messages  # once for the whole absence
    assert told.startswith("epochs up to 6 stay untested, because there is no evaluator: start")


def test_where_no_evaluator_ever_was_tests_are_given_up_in_silence(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    tests = Place(tmp_path)
    tests.now += ABSENCE + 1.0
    for epoch in range(1, 9):
        tests.coordinator.add(epoch_test(epoch), b"w")
    assert sorted(test["epoch"] for test in tests.coordinator.state()) == [5, 6, 7, 8]
    assert not caplog.messages


def test_what_a_lost_evaluator_left_is_played_by_another(tmp_path: Path) -> None:
    tests = Place(tmp_path, "e")
    tests.coordinator.add(epoch_test(1), b"w")
    tests.ask("e")
    assert tests.report("e", 1, 30, [4.0], done=False)

    tests.present = set()
    tests.now += NEWCOMER
    assert tests.coordinator.take_finished() is None
    assert tests.report("e", 1, 0, [], done=False), "its presence may not be known yet"
    tests.now += 0.1
    assert tests.coordinator.take_finished() is None

    assert not tests.report("e", 1, 10, [9.0], done=False), "it was given up"
    assert tests.ask("f").steps == 70
    assert tests.report("f", 1, 70, [6.0], done=True)
    done = tests.coordinator.take_finished()
    assert done is not None
    assert (done.steps, done.scores) == (100, [4.0, 6.0])


def test_one_that_was_lost_after_more_than_its_shard_leaves_nothing_to_play(tmp_path: Path) -> None:
    tests = Place(tmp_path, "e")
    tests.coordinator.add(epoch_test(1), b"w")
    tests.ask("e")
    assert tests.report("e", 1, 120, [4.0], done=False)
    tests.present = set()
    tests.now += NEWCOMER + 0.1
    done = tests.coordinator.take_finished()
    assert done is not None
    assert (done.steps, done.scores) == (120, [4.0])


def test_an_evaluator_that_is_present_may_take_its_time(tmp_path: Path) -> None:
    tests = Place(tmp_path, "e")
    tests.coordinator.add(epoch_test(1), b"w")
    tests.ask("e")
    tests.now += 1e6
    assert tests.coordinator.take_finished() is None
    assert tests.report("e", 1, 100, [1.0], done=True)


def test_an_evaluator_that_is_there_and_says_nothing_holds_up_no_test_for_ever(
    tmp_path: Path,
) -> None:
    """As where its camera hangs, while its heartbeat goes on."""
    tests = Place(tmp_path, "hangs", "plays")
    tests.coordinator.add(epoch_test(1), b"1")
    assert tests.ask("hangs").steps == tests.ask("plays").steps == 50
    for _ in range(2):
        tests.now += 0.6 * MAX_SILENCE
        assert tests.report("plays", 1, 20, [1.0], done=False)
        assert tests.coordinator.take_finished() is None
    assert tests.report("plays", 1, 10, [1.0], done=True)
    assert not tests.report("hangs", 1, 50, [1.0], done=True)
    assert tests.ask("plays").steps == 50
    assert tests.report("plays", 1, 50, [1.0], done=True)
    finished = tests.coordinator.take_finished()
    assert finished is not None
    assert finished.steps == 100


def test_an_evaluator_that_says_that_its_game_goes_on_keeps_its_test(tmp_path: Path) -> None:
    """A game in slow real time may last for hours."""
    tests = Place(tmp_path, "slow", "other")
    tests.coordinator.add(epoch_test(1), b"1")
    assert tests.ask("slow").steps == 50
    for count in range(1, 10):
        tests.now += 0.9 * MAX_SILENCE
        assert tests.report("slow", 1, 0, [], done=False)
        assert tests.coordinator.take_finished() is None
        assert tests.coordinator.reports == count
    assert tests.coordinator.steps_left == 100
    assert tests.report("slow", 1, 50, [1.0], done=True)
    assert not tests.report("other", 1, 0, [], done=False)
    assert tests.coordinator.reports == 10


def test_an_evaluator_that_asks_again_has_given_up_its_job(tmp_path: Path) -> None:
    tests = Place(tmp_path, "e")
    tests.coordinator.add(epoch_test(1), b"w")
    assert tests.ask("e").steps == 100
    assert tests.ask("e").steps == 100
    assert tests.report("e", 1, 100, [1.0], done=True)
    assert tests.coordinator.take_finished() is not None
    assert tests.coordinator.take_finished() is None


def test_two_of_one_name_play_a_whole_test_in_which_each_game_counts_once(tmp_path: Path) -> None:
    tests = Place(tmp_path, "e", "f")
    tests.coordinator.add(epoch_test(1), b"w")
    assert tests.ask("e").steps == 50
    assert tests.report("e", 1, 40, [1.0], done=False)
    assert tests.ask("e").steps == 50, "to the other of that name"
    assert tests.report("e", 1, 5, [2.0], done=False), "of the other"
    assert tests.report("e", 1, 10, [3.0], done=True), "of the first"
    assert not tests.report("e", 1, 20, [4.0], done=False), "the other has to ask again"
    assert tests.coordinator.steps_left == 45
    assert tests.ask("e").steps == 45
    assert tests.report("e", 1, 45, [5.0], done=True)
    done = tests.coordinator.take_finished()
    assert done is not None
    assert (done.steps, done.scores) == (100, [1.0, 2.0, 3.0, 5.0])


def test_nobody_reports_more_than_it_was_asked_for(tmp_path: Path) -> None:
    """Or memory and checkpoint would grow by games without end."""
    tests = Place(tmp_path, "e")
    tests.coordinator.add(epoch_test(1), b"w")
    tests.ask("e")
    assert tests.report("e", 1, 100, [1.0], done=False)
    assert not tests.report("e", 1, 1, [2.0], done=False)
    assert tests.coordinator.state()[0]["scores"] == []
    assert tests.ask("e").kind == "wait"
    done = tests.coordinator.take_finished()
    assert done is not None
    assert done.scores == [1.0]


@pytest.mark.parametrize(("name", "epoch"), [("f", 1), ("e", 2)])
def test_a_report_of_somebody_elses_test_is_refused(tmp_path: Path, name: str, epoch: int) -> None:
    tests = Place(tmp_path, "e")
    tests.coordinator.add(epoch_test(1), b"w")
    tests.coordinator.add(epoch_test(2), b"v")
    tests.ask("e")
    assert not tests.report(name, epoch, 10, [], done=True)
    assert tests.coordinator.pending == 2


def test_the_best_snapshot_is_kept_and_others_go(tmp_path: Path) -> None:
    coordinator = Place(tmp_path).coordinator
    best: float | None = None
    for epoch, scores in ((1, [-20.0]), (2, [2.0, 4.0]), (3, [1.0]), (4, [3.0]), (5, [])):
        test = replace(epoch_test(epoch), scores=scores)
        coordinator.add(test, f"weights of {epoch}".encode())
        coordinator.settle(test, best)
        assert (tmp_path / f"epoch-{epoch:04d}.safetensors").is_file(), "a checkpoint may need it"
        coordinator.sweep()
        if scores:
            mean = sum(scores) / len(scores)
            best = mean if best is None else max(best, mean)
    assert (tmp_path / "best.safetensors").read_bytes() == b"weights of 2"
    assert json.loads((tmp_path / "best.json").read_bytes()) == {
        "epoch": 2,
        "mean_score": 3.0,
        "games": 2,
        "epsilon": 0.05,
        "train_steps": 80,
        "updates": 20,
        "crc32": 0x3A666D01,
    }
    assert not list(tmp_path.glob("epoch-*"))


def test_the_best_snapshot_stays_where_the_table_has_lost_its_test(tmp_path: Path) -> None:
    tests: list[tuple[int, float, float | None]] = [
        (1, 18.0, None),
        (2, 5.0, None),  # a resumed table, without the first
        (3, 19.0, 5.0),
        (4, 18.5, 5.0),
    ]
    for epoch, score, before in tests:
        coordinator = Place(tmp_path).coordinator
        coordinator.add(epoch_test(epoch), f"weights of {epoch}".encode())
        coordinator.settle(replace(epoch_test(epoch), scores=[score]), before)
        expected = b"weights of 1" if epoch < 3 else b"weights of 3"
        assert (tmp_path / "best.safetensors").read_bytes() == expected
    damages = ("{", "[" * 100_000, '{"mean_score": NaN}', '{"mean_score": 1%s}' % ("0" * 400))
    for epoch, damage in enumerate(damages, start=5):
        (tmp_path / "best.json").write_text(damage)
        coordinator.add(epoch_test(epoch), f"weights of {epoch}".encode())
        coordinator.settle(replace(epoch_test(epoch), scores=[1.0]), None)
        assert (tmp_path / "best.safetensors").read_bytes() == f"weights of {epoch}".encode()
    (tmp_path / "best.json").unlink()
    coordinator.settle(replace(epoch_test(1), scores=[1.0]), 2.0)  # the table knows a better one
    assert (tmp_path / "best.safetensors").read_bytes() == b"weights of 8"


def test_a_kill_between_the_card_and_the_weights_of_the_best_test_parts_them_for_no_long_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    coordinator = Place(tmp_path).coordinator
    for epoch, score in ((3, 10.0), (5, 12.0)):
        coordinator.add(epoch_test(epoch), f"weights of {epoch}".encode())
        if epoch == 5:
            monkeypatch.setattr(snapshots, "write_atomically", Mock(side_effect=SystemExit))
        with suppress(SystemExit):
            coordinator.settle(replace(epoch_test(epoch), scores=[score]), None)
    monkeypatch.undo()
    assert (tmp_path / "best.safetensors").read_bytes() == b"weights of 3"
    resumed = Place(tmp_path, "e").coordinator
    assert resumed.restore(coordinator.state()) == []
    assert (tmp_path / "best.safetensors").read_bytes() == b"weights of 5"
    # Played again, its games end otherwise.
    resumed.settle(replace(epoch_test(5), scores=[9.0]), 10.0)
    resumed.sweep()
    assert (tmp_path / "best.safetensors").read_bytes() == b"weights of 5"
    assert json.loads((tmp_path / "best.json").read_bytes())["mean_score"] == 12.0


def test_a_full_disk_between_the_card_and_the_weights_of_the_best_test_loses_neither(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    coordinator = Place(tmp_path).coordinator
    test = replace(epoch_test(2), scores=[5.0])
    coordinator.add(epoch_test(2), b"weights of 2")
    with monkeypatch.context() as full:
        refused = Mock(side_effect=OSError(errno.ENOSPC, "No space left on device"))
        full.setattr(snapshots, "write_atomically", refused)
        with pytest.raises(OSError, match="No space"):
            coordinator.settle(test, None)
    with monkeypatch.context() as broken:  # `insist` tries again, and now it cannot be read
        broken.setattr(snapshots.Snapshots, "read", Mock(side_effect=OSError(errno.EIO, "I/O")))
        coordinator.settle(test, None)
        coordinator.sweep()
    coordinator.settle(test, None)
    coordinator.sweep()
    assert json.loads((tmp_path / "best.json").read_bytes())["epoch"] == 2
    assert (tmp_path / "best.safetensors").read_bytes() == b"weights of 2"


def test_a_snapshot_of_the_best_epochs_number_is_not_the_best_by_that(tmp_path: Path) -> None:
    """The run went on from the previous checkpoint, and its epoch 3 was played anew."""
    coordinator = Place(tmp_path).coordinator
    coordinator.add(epoch_test(3), b"weights of 3")
    coordinator.settle(replace(epoch_test(3), scores=[10.0]), None)
    coordinator.add(epoch_test(3), b"other weights")
    Place(tmp_path).coordinator.restore(coordinator.state())
    assert (tmp_path / "best.safetensors").read_bytes() == b"weights of 3"


def test_best_weights_that_somebody_removed_end_no_run(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    coordinator = Place(tmp_path).coordinator
    coordinator.add(epoch_test(1), b"w")
    coordinator.snapshots.file(1).unlink()
    coordinator.settle(replace(epoch_test(1), scores=[1.0]), None)
    coordinator.sweep()
    assert caplog.messages == [
        "the weights of epoch 1, the best so far, are not kept: their snapshot is missing"
    ]
    assert not list(tmp_path.iterdir())


def test_all_snapshots_are_kept_where_that_is_asked_for(tmp_path: Path) -> None:
    place = Place(tmp_path, keep=True)
    for epoch in range(1, MAX_WAITING + 3):
        place.coordinator.add(epoch_test(epoch), f"weights of {epoch}".encode())
    place.coordinator.settle(replace(epoch_test(1), scores=[3.0]), None)
    place.coordinator.settle(replace(epoch_test(2), scores=[1.0]), 3.0)
    place.coordinator.sweep()
    kept = {path.name: path.read_bytes() for path in tmp_path.glob("*.safetensors")}
    names = {f"epoch-{epoch:04d}.safetensors" for epoch in range(1, MAX_WAITING + 3)}
    assert kept.keys() == {*names, "best.safetensors"}
    assert kept["best.safetensors"] == kept["epoch-0001.safetensors"] == b"weights of 1"


def test_a_pending_test_survives_a_restart(tmp_path: Path) -> None:
    tests = Place(tmp_path, "e")
    tests.coordinator.add(epoch_test(4), b"w")
    tests.ask("e")
    tests.report("e", 4, 30, [4.0], done=False)
    state = tests.coordinator.state()

    again = Place(tmp_path, "e")
    assert again.coordinator.restore(state) == []

    assert again.coordinator.state() == [
        state[0] | {"remaining": 100, "steps": 0, "scores": [], "began": None}
    ]
    assert again.ask("e") == EvaluationJob("test", 4, 100, 0.05, b"w")
    (tmp_path / "epoch-0004.safetensors").unlink()
    last = Place(tmp_path)
    assert last.coordinator.restore(state) == [4]
    assert last.coordinator.pending == 0


@pytest.mark.parametrize("keep", [False, True])
def test_a_snapshot_that_a_killed_learner_left_without_a_test_goes(
    tmp_path: Path, keep: bool
) -> None:
    """The test of 3 was settled; of 5 and 6, which end again, the checkpoint does not know yet."""
    before = Place(tmp_path)
    for epoch in (3, 4, 5, 6):
        before.coordinator.add(epoch_test(epoch), b"w")
    after = Place(tmp_path, keep=keep)
    after.coordinator.restore([test for test in before.coordinator.state() if test["epoch"] == 4])
    assert len(list(tmp_path.iterdir())) == 4, "until there is a checkpoint"
    after.coordinator.add(epoch_test(5), b"again")
    after.coordinator.sweep()
    assert after.coordinator.snapshots.epochs() == ({3, 4, 5, 6} if keep else {4, 5})
    assert after.ask("e").epoch == 4


def test_a_finished_test_that_was_not_recorded_is_in_the_state(tmp_path: Path) -> None:
    tests = Place(tmp_path, "e")
    for epoch in (1, 2, 3):
        tests.coordinator.add(epoch_test(epoch), b"w")
    for epoch in (1, 2):
        tests.ask("e")
        tests.report("e", epoch, 100, [4.0], done=True)
    for left in ([1, 2, 3], [2, 3]):
        assert [test["epoch"] for test in tests.coordinator.state()] == left
        done = tests.coordinator.take_finished()
        assert done is not None
        assert done.epoch == left[0]
        assert [test["epoch"] for test in tests.coordinator.state()] == left
        tests.coordinator.forget(done)
    assert [test["epoch"] for test in tests.coordinator.state()] == [3]


def test_an_epoch_whose_row_cannot_be_written_has_no_test(tmp_path: Path) -> None:
    """Otherwise a resumed run, which ends the epoch anew, would test it twice."""

    def refuse() -> None:
        raise OSError(errno.EIO, "Input/output error")

    coordinator = Place(tmp_path).coordinator
    with pytest.raises(OSError, match="Input/output"):
        coordinator.add(epoch_test(1), b"w", refuse)
    assert (coordinator.pending, coordinator.state()) == (0, [])
