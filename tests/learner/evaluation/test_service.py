"""Evaluators ask and report from other processes."""

import threading
from pathlib import Path

import zenoh

from common.protocol.evaluation import EvaluationJob, EvaluationReport
from common.run.config import ProtocolConfig
from learner.evaluation.coordinator import EvaluationCoordinator
from learner.evaluation.service import EvaluationService
from learner.evaluation.snapshots import Snapshots
from tests.learner.conftest import KEYS
from tests.learner.evaluation.test_coordinator import epoch_test
from tests.patience import PATIENCE

Sessions = tuple[zenoh.Session, zenoh.Session]


def _coordinator(folder: Path) -> EvaluationCoordinator:
    return EvaluationCoordinator(Snapshots(folder), ProtocolConfig(), lambda: {"e"}, lambda: 0.0)


def _ask(client: zenoh.Session, name: str) -> EvaluationJob:
    (reply,) = client.get(KEYS.task, payload=name.encode(), timeout=PATIENCE)
    assert reply.ok is not None
    return EvaluationJob.decode(reply.ok.payload.to_bytes())


def _report(client: zenoh.Session, payload: bytes) -> zenoh.Reply:
    (reply,) = client.get(KEYS.report, payload=payload, timeout=PATIENCE)
    return reply


def test_a_job_is_asked_for_and_reported(sessions: Sessions, tmp_path: Path) -> None:
    hub, client = sessions
    coordinator = _coordinator(tmp_path)
    EvaluationService(hub, KEYS, coordinator)
    coordinator.add(epoch_test(1), b"w")
    job = _ask(client, "e")
    assert (job.kind, job.epoch, job.weights) == ("test", 1, b"w")
    assert _report(client, EvaluationReport("e", 1, 100, (), True).encode()).ok is not None
    assert coordinator.take_finished() is not None


def test_junk_is_refused_and_the_service_continues(sessions: Sessions, tmp_path: Path) -> None:
    hub, client = sessions
    EvaluationService(hub, KEYS, _coordinator(tmp_path))
    assert _report(client, b"junk").err is not None
    assert _report(client, EvaluationReport("e", 9, 10, (), True).encode()).err is not None
    assert _ask(client, "e").kind == "wait"


def test_a_closed_service_answers_nobody_and_leaves_no_thread(
    sessions: Sessions, tmp_path: Path
) -> None:
    hub, client = sessions
    before = set(threading.enumerate())
    service = EvaluationService(hub, KEYS, _coordinator(tmp_path))
    assert len(set(threading.enumerate()) - before) == 2
    assert _ask(client, "e1").kind == "wait"
    service.close()
    assert not any(thread.is_alive() for thread in set(threading.enumerate()) - before)
    assert list(client.get(KEYS.task, payload=b"e1")) == []
