"""Tests are handed out, shared, taken back from the lost, and counted once."""

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import zenoh

import learner.evaluation.coordinator as module
from common.errors import InputError
from common.protocol.chunk import Game
from common.protocol.evaluation import EvaluationJob, EvaluationReport
from common.run.config import ProtocolConfig
from learner.evaluation.coordinator import EpochTest, EvaluationCoordinator
from tests.learner.conftest import KEYS
from tests.patience import PATIENCE

PROTOCOL = replace(ProtocolConfig(), test_steps=100, test_epsilon=0.05)


Sessions = tuple[zenoh.Session, zenoh.Session]


class Evaluators:
    """Who lives; the examiner asks."""

    def __init__(self, *names: str) -> None:
        self.living = set(names)

    def __call__(self) -> set[str]:
        return self.living


def _examiner(
    hub: zenoh.Session, folder: Path, living: Callable[[], set[str]]
) -> EvaluationCoordinator:
    return EvaluationCoordinator(hub, KEYS, folder, PROTOCOL, living, lambda: 12.5)


def _test(epoch: int) -> EpochTest:
    return EpochTest(
        epoch=epoch,
        weight_updates=epoch * 10,
        total_train_steps=epoch * 40,
        replay_memory_count=epoch * 40,
        meanq=0.5,
        remaining=PROTOCOL.test_steps,
    )


def _ask(client: zenoh.Session, name: str) -> EvaluationJob:
    (reply,) = client.get(KEYS.task, payload=name.encode(), timeout=PATIENCE)
    assert reply.ok is not None
    return EvaluationJob.decode(reply.ok.payload.to_bytes())


def _report(client: zenoh.Session, name: str, epoch: int, steps: int, scores: list[float],
            done: bool) -> bool:  # fmt: skip
    report = EvaluationReport(name, epoch, steps, tuple(Game(score, 10) for score in scores), done)
    (reply,) = client.get(KEYS.report, payload=report.encode(), timeout=PATIENCE)
    return reply.ok is not None


def test_one_evaluator_plays_a_whole_test(sessions: Sessions, tmp_path: Path) -> None:
    hub, client = sessions
    examiner = _examiner(hub, tmp_path, Evaluators("e"))
    assert _ask(client, "e").kind == "wait"
    examiner.add(_test(1), b"weights of 1")

    assert _ask(client, "e") == EvaluationJob("test", 1, 100, 0.05, b"weights of 1")
    assert _report(client, "e", 1, 60, [-3.0], done=False)
    assert examiner.take_finished() is None
    assert examiner.steps_left == 40
    assert _report(client, "e", 1, 50, [5.0], done=True)

    done = examiner.take_finished()
    assert done is not None
    assert (done.epoch, done.steps, done.scores, done.began) == (1, 110, [-3.0, 5.0], 12.5)
    assert examiner.pending == 0
    assert _ask(client, "e").kind == "wait"
    examiner.finish()
    assert _ask(client, "e").kind == "finished"


def test_two_evaluators_share_a_test(sessions: Sessions, tmp_path: Path) -> None:
    hub, client = sessions
    examiner = _examiner(hub, tmp_path, Evaluators("e", "f"))
    examiner.add(_test(1), b"w")
    examiner.add(_test(2), b"v")
    assert [_ask(client, name).steps for name in ("e", "f")] == [50, 50]
    assert _report(client, "e", 1, 50, [1.0], done=True)
    assert examiner.take_finished() is None
    assert _ask(client, "e").epoch == 2
    assert _report(client, "f", 1, 55, [2.0], done=True)
    done = examiner.take_finished()
    assert done is not None
    assert (done.steps, sorted(done.scores)) == (105, [1.0, 2.0])


def test_where_nobody_tests_only_the_newest_wait_and_the_others_files_go(
    sessions: Sessions, tmp_path: Path
) -> None:
    hub, client = sessions
    evaluators = Evaluators("e")
    examiner = _examiner(hub, tmp_path, evaluators)
    examiner.add(_test(1), b"1")
    assert _ask(client, "e").epoch == 1
    evaluators.living = set()  # but what it was given is still its own
    for epoch in range(2, 9):
        examiner.add(_test(epoch), b"w")
    assert sorted(test["epoch"] for test in examiner.state()) == [1, 5, 6, 7, 8]
    assert len(list(tmp_path.iterdir())) == 8  # until a checkpoint needs them no more
    examiner.sweep()
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        f"epoch-{epoch:04d}.safetensors" for epoch in (1, 5, 6, 7, 8)
    ]
    evaluators.living = {"e"}
    for epoch in (9, 10):
        examiner.add(_test(epoch), b"w")
    assert examiner.pending == 7


def test_what_a_lost_evaluator_left_is_played_by_another(
    sessions: Sessions, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_NEWCOMER", 0.0)
    hub, client = sessions
    evaluators = Evaluators("e")
    examiner = _examiner(hub, tmp_path, evaluators)
    examiner.add(_test(1), b"w")
    _ask(client, "e")
    assert _report(client, "e", 1, 30, [4.0], done=False)

    evaluators.living = set()
    assert examiner.take_finished() is None

    assert not _report(client, "e", 1, 10, [9.0], done=False), "it was given up"
    assert _ask(client, "f").steps == 70
    assert _report(client, "f", 1, 70, [6.0], done=True)
    done = examiner.take_finished()
    assert done is not None
    assert (done.steps, done.scores) == (100, [4.0, 6.0])


def test_an_evaluator_that_asks_again_has_given_up_its_task(
    sessions: Sessions, tmp_path: Path
) -> None:
    hub, client = sessions
    examiner = _examiner(hub, tmp_path, Evaluators("e"))
    examiner.add(_test(1), b"w")
    assert _ask(client, "e").steps == 100
    assert _ask(client, "e").steps == 100
    assert _report(client, "e", 1, 100, [1.0], done=True)
    assert examiner.take_finished() is not None
    assert examiner.take_finished() is None


def test_the_best_snapshot_is_kept_and_others_go(sessions: Sessions, tmp_path: Path) -> None:
    examiner = _examiner(sessions[0], tmp_path, Evaluators())
    best: float | None = None
    for epoch, score in ((1, -20.0), (2, 3.0), (3, 1.0)):
        test = replace(_test(epoch), scores=[score])
        examiner.add(test, f"weights of {epoch}".encode())
        examiner.settle(test, best)
        best = score if best is None else max(best, score)
    assert (tmp_path / "best.safetensors").read_bytes() == b"weights of 2"
    assert '"epoch": 2' in (tmp_path / "best.json").read_text()
    assert not list(tmp_path.glob("epoch-*"))


def test_a_pending_test_survives_a_restart(sessions: Sessions, tmp_path: Path) -> None:
    hub, client = sessions
    examiner = _examiner(hub, tmp_path, Evaluators("e"))
    examiner.add(_test(4), b"w")
    _ask(client, "e")
    _report(client, "e", 4, 30, [4.0], done=False)
    again = EvaluationCoordinator.__new__(
        EvaluationCoordinator
    )  # its queryables would compete with the first one's
    again.__dict__.update(examiner.__dict__ | {"_tests": {}, "_shards": {}})

    again.restore(examiner.state())

    assert again.state()[0] | {"remaining": 100, "steps": 0, "scores": []} == again.state()[0]
    (tmp_path / "epoch-0004.safetensors").unlink()
    with pytest.raises(InputError, match="epoch-0004"):
        again.restore(examiner.state())


def test_junk_is_refused_and_the_examiner_goes_on(sessions: Sessions, tmp_path: Path) -> None:
    hub, client = sessions
    examiner = _examiner(hub, tmp_path, Evaluators("e"))
    (reply,) = client.get(KEYS.report, payload=b"junk", timeout=PATIENCE)
    assert reply.err is not None
    assert not _report(client, "e", 9, 10, [], done=True)
    examiner.add(_test(1), b"w")
    assert _ask(client, "e").kind == "test"


def test_a_closed_examiner_answers_nobody_and_leaves_no_thread(
    sessions: Sessions, tmp_path: Path
) -> None:
    hub, client = sessions
    before = set(threading.enumerate())
    examiner = _examiner(hub, tmp_path, Evaluators("e1"))
    assert len(set(threading.enumerate()) - before) == 2
    assert _ask(client, "e1").kind == "wait"
    examiner.close()
    assert not any(thread.is_alive() for thread in set(threading.enumerate()) - before)
    assert list(client.get(KEYS.task, payload=b"e1")) == []
