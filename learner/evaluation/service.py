"""Lets evaluators in other processes ask the coordinator for jobs, and report."""

import threading
from collections.abc import Callable
from typing import Any

import zenoh
from zenoh.handlers import FifoChannel

from common.errors import MessageError
from common.protocol.evaluation import EvaluationReport
from common.protocol.run_keys import RunKeys
from learner.evaluation.coordinator import EvaluationCoordinator

_QUEUE = 256


class EvaluationService:
    """Answers from threads of its own until it is closed."""

    def __init__(
        self, session: zenoh.Session, keys: RunKeys, coordinator: EvaluationCoordinator
    ) -> None:
        def give_job(payload: bytes) -> bytes:
            return coordinator.give_job(payload[:200].decode(errors="replace")).encode()

        def take_report(payload: bytes) -> bytes:
            coordinator.take_report(EvaluationReport.decode(payload))
            return b"ok"

        self._queryables: list[Any] = []
        self._threads: list[threading.Thread] = []
        for key, answer in ((keys.task, give_job), (keys.report, take_report)):
            queryable = session.declare_queryable(key, FifoChannel(_QUEUE))
            thread = threading.Thread(
                target=_serve, args=(queryable, answer), name="evaluation", daemon=True
            )
            thread.start()
            self._queryables.append(queryable)
            self._threads.append(thread)

    def close(self) -> None:
        """Stop answering.

        A thread that still waits for Zenoh when the interpreter ends would bring the process down
        with "FATAL: exception not rethrown".
        """
        for queryable in self._queryables:
            queryable.undeclare()
        for thread in self._threads:
            thread.join()


def _serve(queryable: Any, answer: Callable[[bytes], bytes]) -> None:
    for query in queryable:
        with query:
            payload = query.payload.to_bytes() if query.payload is not None else b""
            try:
                query.reply(query.key_expr, answer(payload))
            except MessageError as error:
                query.reply_err(str(error).encode())
