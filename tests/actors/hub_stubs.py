"""A hub's side of a conversation, played by the test itself: it answers when the test says so."""

import queue
from collections.abc import Iterator

import pytest
import zenoh
from zenoh.handlers import Callback

from common.protocol.ack import Ack
from tests.patience import PATIENCE

STORED = Ack("stored", throttle=False, finished=False, agent_steps=0, weights_version=0)


def payload_of(query: zenoh.Query) -> bytes:
    return query.payload.to_bytes() if query.payload is not None else b""


class PendingQueries:
    """Queries to ``key``, in order of arrival, for the test to answer one by one."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._closed = False
        self._queries: queue.SimpleQueue[zenoh.Query] = queue.SimpleQueue()
        self._queryable = session.declare_queryable(
            key, Callback(self._queries.put, indirect=False)
        )

    def next(self) -> zenoh.Query:
        try:
            return self._queries.get(timeout=PATIENCE)
        except queue.Empty:
            pytest.fail("waited in vain for a query")

    def waiting(self) -> Iterator[zenoh.Query]:
        """Those that are there already."""
        while not self._queries.empty():
            yield self._queries.get()

    def close(self) -> None:
        """Listen no more; those that wait get no answer. A second time does nothing."""
        if self._closed:
            return
        self._closed = True
        self._queryable.undeclare()  # type: ignore[no-untyped-call]
        for query in self.waiting():
            ignore(query)


def answer(query: zenoh.Query, payload: bytes) -> None:
    with query:
        query.reply(query.key_expr, payload)


def acknowledge(query: zenoh.Query, ack: Ack = STORED) -> None:
    answer(query, ack.encode())


def refuse(query: zenoh.Query, sentence: str) -> None:
    with query:
        query.reply_err(sentence)


def ignore(query: zenoh.Query) -> None:
    """End it without an answer, as happens when a server goes away."""
    query.drop()  # type: ignore[no-untyped-call]
