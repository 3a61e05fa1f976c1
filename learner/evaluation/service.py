"""Lets evaluators in other processes ask the coordinator for jobs, and send it reports."""

import logging
from dataclasses import replace

from common.errors import MessageError
from common.process.log_lines import Seldom
from common.protocol.evaluation import EvaluationReport
from common.protocol.run_keys import RunKeys, name_in
from common.transport.interface import Request, Transport
from common.transport.leaky_bucket import REPORTS_PER_SECOND, LeakyBucket
from common.transport.signature import Sign
from learner.evaluation.coordinator import EvaluationCoordinator

_log = logging.getLogger(__name__)
_log.addFilter(Seldom())


def serve_evaluators(
    transport: Transport,
    keys: RunKeys,
    coordinator: EvaluationCoordinator,
    sign: Sign,
    most_reports: float = REPORTS_PER_SECOND,
) -> None:
    """Answers evaluators until ``transport`` is closed.

    Args:
        sign: signs the weights of jobs.
        most_reports: maximum number of reports that are taken from one evaluator per second.
    """
    quota = LeakyBucket(most_reports)

    def give_job(request: Request) -> bytes:
        evaluator = name_in(request.key)
        job = coordinator.give_job(evaluator)
        test = job.kind == "test"
        signature = sign("test", job.epoch, keys.run_id, job.weights) if test else b""
        return replace(job, run_id=keys.run_id, signature=signature).encode()

    def take_report(request: Request) -> bytes | None:
        evaluator = name_in(request.key)
        if not quota.admits(evaluator):
            who = evaluator if quota.knows(evaluator) else "a crowd of new evaluators"
            _log.warning("%s reports too often: some reports are dropped", who)
            transport.note_over_quota(evaluator)
            request.drop()
            return None
        report = EvaluationReport.decode(request.payload)
        if report.evaluator != evaluator:
            raise MessageError(f"a report of {report.evaluator} at the key of {evaluator}")
        if report.run_id != keys.run_id:
            raise MessageError("a report of another run")
        coordinator.take_report(report)
        return b"ok"

    transport.serve(keys.job("*"), give_job)
    transport.serve(keys.report("*"), take_report)
