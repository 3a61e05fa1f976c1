"""Evaluators ask and report from other processes."""

from dataclasses import replace
from pathlib import Path

import pytest

from common.errors import MessageError
from common.protocol.evaluation import EvaluationJob, EvaluationReport
from common.settings.config import ProtocolConfig
from common.transport.interface import Transport, Unanswered
from common.transport.signature import unsigned
from learner.evaluation.coordinator import EvaluationCoordinator
from learner.evaluation.service import serve_evaluators
from learner.evaluation.snapshots import Snapshots
from tests.learner.conftest import KEYS
from tests.learner.evaluation.test_coordinator import epoch_test
from tests.patience import PATIENCE


def _coordinator(folder: Path) -> EvaluationCoordinator:
    return EvaluationCoordinator(Snapshots(folder), ProtocolConfig(), lambda: {"e"}, lambda: 0.0)


def _ask(client: Transport, name: str) -> EvaluationJob:
    answer = client.requester(KEYS.job(name), PATIENCE).request(b"").result()
    return EvaluationJob.decode(answer.payload)


def _report(client: Transport, payload: bytes, name: str = "e") -> None:
    client.requester(KEYS.report(name), PATIENCE).request(payload).result()


def test_a_job_is_asked_for_and_reported(hub: Transport, client: Transport, tmp_path: Path) -> None:
    coordinator = _coordinator(tmp_path)
    serve_evaluators(hub, KEYS, coordinator, unsigned)
    coordinator.add(epoch_test(1), b"w")
    job = _ask(client, "e")
    assert (job.kind, job.epoch, job.weights) == ("test", 1, b"w")
    _report(client, EvaluationReport("e", 1, 100, (), True).encode())
    assert coordinator.take_finished() is not None


def test_the_weights_of_a_job_are_signed(hub: Transport, client: Transport, tmp_path: Path) -> None:
    coordinator = _coordinator(tmp_path)
    serve_evaluators(hub, KEYS, coordinator, lambda *told: repr(told).encode())
    coordinator.add(epoch_test(1), b"w")
    assert _ask(client, "e").signature == repr(("test", 1, KEYS.run_id, b"w")).encode()


def test_junk_is_refused_and_the_service_continues(
    hub: Transport, client: Transport, tmp_path: Path
) -> None:
    serve_evaluators(hub, KEYS, _coordinator(tmp_path), unsigned)
    for junk in (b"junk", EvaluationReport("e", 9, 10, (), True).encode()):
        with pytest.raises(MessageError):
            _report(client, junk)
    assert _ask(client, "e").kind == "wait"


def test_nobody_reports_in_another_name(hub: Transport, client: Transport, tmp_path: Path) -> None:
    coordinator = _coordinator(tmp_path)
    serve_evaluators(hub, KEYS, coordinator, unsigned)
    coordinator.add(epoch_test(1), b"w")
    assert _ask(client, "e").kind == "test"
    report = EvaluationReport("e", 1, 100, (), True).encode()
    with pytest.raises(MessageError, match=r"^a report of e at the key of other$"):
        _report(client, report, "other")
    assert coordinator.take_finished() is None
    _report(client, report)
    assert coordinator.take_finished() is not None


def test_a_report_of_another_run_does_not_count(
    hub: Transport, client: Transport, tmp_path: Path
) -> None:
    coordinator = _coordinator(tmp_path)
    serve_evaluators(hub, KEYS, coordinator, unsigned)
    coordinator.add(epoch_test(1), b"w")
    job = _ask(client, "e")
    report = EvaluationReport("e", 1, 100, (), True, run_id=job.run_id)
    with pytest.raises(MessageError, match=r"^a report of another run$"):
        _report(client, replace(report, run_id="another").encode())
    assert coordinator.take_finished() is None
    _report(client, report.encode())
    assert coordinator.take_finished() is not None


def test_who_reports_too_often_is_not_heard_until_later(
    hub: Transport, client: Transport, tmp_path: Path
) -> None:
    coordinator = _coordinator(tmp_path)
    serve_evaluators(hub, KEYS, coordinator, unsigned, most_reports=1e-9)
    coordinator.add(epoch_test(1), b"w")
    assert _ask(client, "e").kind == "test"
    with pytest.raises(MessageError):
        _report(client, b"junk")
    with pytest.raises(Unanswered):
        _report(client, b"junk")
    assert coordinator.steps_left == ProtocolConfig().test_steps
    with pytest.raises(MessageError):
        _report(client, b"junk", "another")


@pytest.mark.parametrize("name", ["-e", "e" * 65, "*"])
def test_an_evaluator_without_a_proper_name_has_no_job(
    hub: Transport, client: Transport, tmp_path: Path, name: str
) -> None:
    coordinator = _coordinator(tmp_path)
    serve_evaluators(hub, KEYS, coordinator, unsigned)
    coordinator.add(epoch_test(1), b"w")
    with pytest.raises(MessageError, match="no process can have the name in this key"):
        _ask(client, name)
    with pytest.raises(MessageError, match="no process can have the name in this key"):
        _report(client, b"", name)
    assert _ask(client, "e").kind == "test"  # all of it is left


def test_a_closed_transport_answers_nobody(
    hub: Transport, client: Transport, tmp_path: Path
) -> None:
    serve_evaluators(hub, KEYS, _coordinator(tmp_path), unsigned)
    assert _ask(client, "e1").kind == "wait"
    hub.close()
    assert not client.requester(KEYS.job("e1"), PATIENCE).has_server
