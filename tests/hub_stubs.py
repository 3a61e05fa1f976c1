"""A hub's side of a conversation, played by the test itself: it answers when the test says so."""

import queue
from collections.abc import Iterator

import pytest

from common.protocol.ack import Ack
from common.transport.interface import Request, Transport
from tests.patience import PATIENCE

STORED = Ack(
    "stored", throttle=False, finished=False, agent_steps=0, difficulty=1.0, weights_version=0
)


class PendingRequests:
    """Requests at ``key``, in order of arrival, for the test to answer one by one."""

    def __init__(self, transport: Transport, key: str) -> None:
        self._requests: queue.SimpleQueue[Request] = queue.SimpleQueue()
        self._service = transport.serve(key, self._requests.put)

    def next(self) -> Request:
        try:
            return self._requests.get(timeout=PATIENCE)
        except queue.Empty:
            pytest.fail("waited in vain for a request")

    def waiting(self) -> Iterator[Request]:
        """Those that are there already."""
        while not self._requests.empty():
            yield self._requests.get()

    def close(self) -> None:
        """Listen no more; those that wait get no answer. A second time does nothing."""
        self._service.close()
        for request in self.waiting():
            request.drop()


def acknowledge(request: Request, ack: Ack = STORED) -> None:
    request.reply(ack.encode())
