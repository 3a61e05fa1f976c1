"""Code that all transports share: it settles each request once, answers it, and resends it."""

import contextlib
import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from functools import partial

from common.errors import InputError, MessageError
from common.process.log_lines import Seldom
from common.process.threads import guarded
from common.transport.checksum import DamagedMessage
from common.transport.interface import Answer, Envelope, Request, Requester, Unanswered

_FIRST_PAUSE = 0.1
_LONGEST_PAUSE = 5.0
"""Maximum seconds from one sending of a request to the next; the pause doubles each time."""
LONGEST_ANSWER = 10.0
"""Maximum seconds that closing a service waits for the request that is being answered."""
LONGEST_REASON = 500
"""Maximum characters of a refusal, which may repeat parts of the refused message."""
_log = logging.getLogger(__name__)
_log.addFilter(Seldom())


def answer_request(request: Request, answer: Answer) -> None:
    """Ends ``request`` as `Answer` describes, unless ``answer`` has kept it."""
    try:
        found = answer(request)
        if found is not None:
            request.reply(found)
    except MessageError as error:
        request.refuse(str(error)[:LONGEST_REASON])
    except DamagedMessage as error:
        _log.warning("a request at %s is not answered: %s", request.key, error)
        request.drop()
    except (InputError, OSError) as error:
        _log.warning("a request at %s found no answer: %s", request.key, error)
        request.drop()
    except Exception:
        _log.exception("a request at %s found no answer", request.key)
        request.drop()


class PendingRequests:
    """The future answers of one requester. Each is settled once, by whatever comes first."""

    def __init__(self) -> None:
        self._under_way: set[Future[Envelope]] = set()
        self._closed = False

    def begin(self) -> Future[Envelope]:
        """Returns a new future answer, which has already ended if this was closed."""
        future: Future[Envelope] = Future()
        self._under_way.add(future)
        future.add_done_callback(self._under_way.discard)
        if self._closed:
            self.settle(future, Unanswered("the requester was closed"))
        return future

    def settle(self, future: Future[Envelope], outcome: Envelope | Exception) -> None:
        """Ends ``future`` with ``outcome``, unless it has already ended."""
        with contextlib.suppress(InvalidStateError):
            if isinstance(outcome, Exception):
                future.set_exception(outcome)
            else:
                future.set_result(outcome)

    def close(self) -> None:
        """Ends all pending answers, and all later ones, as unanswered."""
        self._closed = True
        for future in list(self._under_way):
            self.settle(future, Unanswered("the requester was closed"))


class _Pending:
    """A request under way; ``lost`` once it ended without an answer."""

    def __init__(self, payload: bytes) -> None:
        self.payload = payload
        self.lost = False
        self.tries = 0
        self.again = 0.0
        """Monotonic time from which it may be sent again."""


class Window:
    """Sends requests, and sends each again until it is answered or refused, so that none is lost.

    Calls of `send` and `wait` send lost requests again, after growing pauses. They do so only while
    a server is known, because without one a request would end at once. The server must recognise a
    request that it has already received.

    Args:
        settled: called once with each answer or refusal, on a thread of the transport.
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
        """Sends a request, without waiting for earlier ones."""
        pending = _Pending(payload)
        with self._changed:
            self._pending.append(pending)
        self._send(pending)
        self._send_lost()

    def wait(self, most: int, seconds: float) -> bool:
        """Waits up to ``seconds`` until at most ``most`` requests are unsettled; returns whether
        that is so."""
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
                self._settled(outcome)  # first: if none is pending, all answers have been handled
                self._pending.remove(pending)
            else:
                pending.lost = True
            self._changed.notify_all()
