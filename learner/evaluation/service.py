"""Lets evaluators in other processes ask the coordinator for jobs, and report."""

from dataclasses import replace

from common.protocol.evaluation import EvaluationReport
from common.protocol.run_keys import RunKeys
from common.transport.interface import Request, Transport
from learner.evaluation.coordinator import EvaluationCoordinator


def serve_evaluators(
    transport: Transport, keys: RunKeys, coordinator: EvaluationCoordinator
) -> None:
    """Answer evaluators until ``transport`` is closed."""

    def give_job(request: Request) -> bytes:
        job = coordinator.give_job(request.payload[:200].decode(errors="replace"))
        return replace(job, run_id=keys.run_id).encode()

    def take_report(request: Request) -> bytes:
        coordinator.take_report(EvaluationReport.decode(request.payload))
        return b"ok"

    transport.serve(keys.task, give_job)
    transport.serve(keys.report, take_report)
