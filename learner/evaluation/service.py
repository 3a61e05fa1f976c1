"""Lets evaluators in other processes ask the coordinator for jobs, and report."""

import re
from dataclasses import replace

from common.checked import NAME
from common.errors import MessageError
from common.protocol.evaluation import EvaluationReport
from common.protocol.run_keys import RunKeys, name_in
from common.transport.interface import Request, Transport
from learner.evaluation.coordinator import EvaluationCoordinator


def serve_evaluators(
    transport: Transport, keys: RunKeys, coordinator: EvaluationCoordinator
) -> None:
    """Answer evaluators until ``transport`` is closed."""

    def give_job(request: Request) -> bytes:
        evaluator = name_in(request.key)
        if not re.fullmatch(NAME, evaluator):
            raise MessageError("no evaluator can have this name")
        job = coordinator.give_job(evaluator)
        return replace(job, run_id=keys.run_id).encode()

    def take_report(request: Request) -> bytes:
        report, evaluator = EvaluationReport.decode(request.payload), name_in(request.key)
        if report.evaluator != evaluator:
            raise MessageError(f"a report of {report.evaluator} at the key of {evaluator}")
        coordinator.take_report(report)
        return b"ok"

    transport.serve(keys.task("*"), give_job)
    transport.serve(keys.report("*"), take_report)
