"""`PendingQueries`: queries of one kind that are under way, for those who do not wait for each
answer.

A queryable answers in the order in which it is asked, so a client that has several questions under
way is neither held up by the way there and back, nor by what the other side is doing meanwhile.
"""

import threading
from collections import deque
from typing import Any

import zenoh
from zenoh.handlers import Callback

from common.errors import MessageError

PATIENCE = 5.0
"""Seconds for an answer, before the server counts as away."""


class PendingQueries:
    """Asks at ``key``, and keeps the answers until they are taken. Safe for several threads."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._session = session
        self._key = key
        self._changed = threading.Condition()
        self._answers: deque[zenoh.ZBytes | MessageError | None] = deque()
        self._under_way = 0
        self._closed = False

    @property
    def open(self) -> int:
        """PendingQueries whose answers were not taken yet."""
        with self._changed:
            return self._under_way + len(self._answers)

    def ask(self, request: bytes) -> None:
        """Send ``request`` without waiting for its answer."""
        settled = False

        def settle(answer: zenoh.ZBytes | MessageError | None) -> None:
            nonlocal settled
            with self._changed:
                if not settled:
                    settled = True
                    self._under_way -= 1
                    self._answers.append(answer)
                    self._changed.notify_all()

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                settle(reply.ok.payload)
            elif reply.err is not None:
                text = reply.err.payload.to_bytes().decode(errors="replace")
                if text != "Timeout":  # Zenoh's own word for a query that nobody answered
                    settle(MessageError(f"the replay refused a question: {text}"))

        with self._changed:
            self._under_way += 1
        handler: Any = Callback(on_reply, lambda: settle(None), indirect=False)
        self._session.get(
            self._key,
            handler,
            payload=request,
            timeout=PATIENCE,
            consolidation=zenoh.ConsolidationMode.NONE,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )

    def take(self, timeout: float | None = None) -> bytes | None:
        """The oldest answer; None of a server that is away, or when there is nothing to wait for.

        Args:
            timeout: seconds to wait; None for as long as the server may take, `PATIENCE`.

        Raises:
            MessageError: the server refused that question.
            TimeoutError: none came for ``timeout`` seconds.
        """
        with self._changed:
            self._changed.wait_for(
                lambda: self._answers or not self._under_way or self._closed, timeout
            )
            if not self._answers:
                if self._under_way and not self._closed:
                    raise TimeoutError
                return None
            answer = self._answers.popleft()
        if isinstance(answer, MessageError):
            raise answer
        return None if answer is None else answer.to_bytes()

    def clear(self) -> None:
        """Pass over the answers that came.

        Raises:
            MessageError: one of them was a refusal.
        """
        with self._changed:
            answers = list(self._answers)
            self._answers.clear()
        for answer in answers:
            if isinstance(answer, MessageError):
                raise answer

    def close(self) -> None:
        """Let those go that wait."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
