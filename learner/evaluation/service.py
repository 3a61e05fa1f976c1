"""Lets evaluators in other processes ask the coordinator for jobs, and report."""

from common.protocol.evaluation import EvaluationReport
from common.protocol.run_keys import RunKeys
from common.transport.interface import Request, Transport
from learner.evaluation.coordinator import EvaluationCoordinator


class EvaluationService:
    """Answers from threads of its own until it is closed."""

    def __init__(
        self, transport: Transport, keys: RunKeys, coordinator: EvaluationCoordinator
    ) -> None:
        def give_job(request: Request) -> bytes:
            return coordinator.give_job(request.payload[:200].decode(errors="replace")).encode()

        def take_report(request: Request) -> bytes:
            coordinator.take_report(EvaluationReport.decode(request.payload))
            return b"ok"

        self._services = [
            transport.serve(keys.task, give_job),
            transport.serve(keys.report, take_report),
        ]

    def close(self) -> None:
        """Stop answering."""
        for service in self._services:
            service.close()
