"""What all transports do alike: settle each request once, answer it, and send it again."""

import contextlib
import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from functools import partial

from common.errors import MessageError
from common.process.log_lines import Seldom
from common.process.threads import guarded
from common.transport.checksum import DamagedMessage
from common.transport.interface import Answer, Envelope, Request, Requester, Unanswered

_FIRST_PAUSE = 0.1
_LONGEST_PAUSE = 5.0
"""Seconds from one sending of a request to the next, twice as many after each."""
LONGEST_ANSWER = 10.0
"""Seconds that closing a service waits for the request that is being answered."""
LONGEST_REASON = 500
"""Characters of a refusal, which may repeat some of what is refused."""
_log = logging.getLogger(__name__)
_log.addFilter(Seldom())


def answer_request(request: Request, answer: Answer) -> None:
    """End ``request`` as `Answer` promises, unless ``answer`` has kept it."""
    try:
        found = answer(request)
        if found is not None:
            request.reply(found)
    except MessageError as error:
        request.refuse(str(error)[:LONGEST_REASON])
    except DamagedMessage as error:
        _log.warning("a request at %s is not answered: %s", request.key, error)
        request.drop()
    except OSError as error:
        _log.warning("a request at %s found no answer: %s", request.key, error)
        request.drop()
    except Exception:
        _log.exception("a request at %s found no answer", request.key)
        request.drop()


class PendingRequests:
    """The answers to come of one requester: each is settled once, by whatever comes first."""

    def __init__(self) -> None:
        self._under_way: set[Future[Envelope]] = set()
        self._closed = False

    def begin(self) -> Future[Envelope]:
        """Return a new answer to come, which has ended already if this was closed."""
        future: Future[Envelope] = Future()
        self._under_way.add(future)
        future.add_done_callback(self._under_way.discard)
        if self._closed:
            self.settle(future, Unanswered("the requester was closed"))
        return future

    def settle(self, future: Future[Envelope], outcome: Envelope | Exception) -> None:
        """End ``future`` with ``outcome``, unless it has ended."""
        with contextlib.suppress(InvalidStateError):
            if isinstance(outcome, Exception):
                future.set_exception(outcome)
            else:
                future.set_result(outcome)

    def close(self) -> None:
        """End all that are under way, and all to come, unanswered."""
        self._closed = True
        for future in list(self._under_way):
            self.settle(future, Unanswered("the requester was closed"))


class _Pending:
    """A request on its way; ``lost`` when it ended without an answer."""

    def __init__(self, payload: bytes) -> None:
        self.payload = payload
        self.lost = False
        self.tries = 0
        self.again = 0.0
        """Monotonic seconds from which it may be sent again."""


class Window:
    """Requests of which none is lost: each is sent again until it is answered or refused.

    They are sent again, ever more seldom, by whoever calls `send` or `wait`, and only while a
    server is known: without one they would end again at once. The server must recognise a request
    that it has had.

    Args:
        settled: takes each answer or refusal, once, on a thread of the transport.
    """

    def __init__(
        self, requester: Requester, settled: Callable[[Envelope | MessageError], None]
    ) -> None:
        self.sent_again = 0
        self._requester = requester
        self._settled = settled
        self._pending: list[_Pending] = []  # oldest first
        self._changed = threading.Condition()

    def __len__(self) -> int:
        return len(self._pending)

    def send(self, payload: bytes) -> None:
        """Send a request without waiting for room."""
        pending = _Pending(payload)
        with self._changed:
            self._pending.append(pending)
        self._send(pending)
        self._send_lost()

    def wait(self, most: int, seconds: float) -> bool:
        """Wait for up to ``seconds`` until ``most`` are unsettled; return whether that is so."""
        self._send_lost()
        with self._changed:
            return self._changed.wait_for(lambda: len(self._pending) <= most, seconds)

    def _send_lost(self) -> None:
        now = time.monotonic()
        lost = [each for each in self._pending if each.lost and each.again <= now]
        if lost and self._requester.has_server:
            for pending in lost:
                self.sent_again += 1
                self._send(pending)

    def _send(self, pending: _Pending) -> None:
        pending.lost = False
        pending.again = time.monotonic() + min(_FIRST_PAUSE * 2**pending.tries, _LONGEST_PAUSE)
        pending.tries = min(pending.tries + 1, 30)
        future = self._requester.request(pending.payload)
        future.add_done_callback(guarded("window", partial(self._end, pending)))

    def _end(self, pending: _Pending, future: Future[Envelope]) -> None:
        outcome = future.exception() or future.result()
        with self._changed:
            if isinstance(outcome, Envelope | MessageError):
                self._settled(outcome)  # first: whoever finds none pending has all their answers
                self._pending.remove(pending)
            else:
                pending.lost = True
            self._changed.notify_all()
