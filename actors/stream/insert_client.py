"""Sends chunks so that none is lost: inserts are acknowledged, and a window of them is in flight.

An insert is a request, and its answer is the acknowledgement. Without an answer (the server is
away, or too slow) it is sent again, and the server drops duplicates.
"""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

from actors.absence import Absence
from actors.member import Member
from common.errors import MessageError
from common.protocol.ack import Ack
from common.transport.interface import Envelope, Unanswered
from common.transport.requests import Window

ACK_TIMEOUT = 5.0
"""Seconds after which an insert without an answer is sent again."""
_PAUSE = 0.2
_AWAY = 2.0
"""Seconds without a hub after which a leaving actor no longer waits for it."""


class InsertClient:
    """Keeps at most ``stream.window`` chunks unacknowledged; `send` waits for room.

    Args:
        paused: returns a context for a wait, in which no game time passes.
    """

    def __init__(
        self, member: Member, paused: Callable[[], AbstractContextManager[object]] = nullcontext
    ) -> None:
        self.made = 0
        self.acked = 0
        self.refused = 0
        self.last_ack: Ack | None = None
        self._member = member
        self._paused = paused
        self.window = member.config.stream.window
        self._missed_since: float | None = None
        self._absence = Absence(member, "hub", "actor")
        key = member.keys.insert(member.name)
        self._requester = member.transport.requester(key, ACK_TIMEOUT)
        self._inserts = Window(self._requester, self._settle)

    @property
    def unacknowledged(self) -> int:
        return len(self._inserts)

    @property
    def retried(self) -> int:
        """Chunks that were sent again."""
        return self._inserts.sent_again

    def post(self, payload: bytes) -> None:
        """Sends one encoded chunk without waiting for room."""
        self.made += 1
        self._inserts.send(payload)

    def send(self, payload: bytes) -> None:
        """Sends one encoded chunk, and waits until the window has room for the next.

        Raises:
            InputError: there was no hub for longer than the patience.
        """
        self.post(payload)
        if self.unacknowledged < self.window:
            return
        with self._paused():
            while self.unacknowledged >= self.window and not self._member.stop.is_set():
                self._look_for_hub()
                self._inserts.wait(self.window - 1, _PAUSE)

    def flush(self, seconds: float) -> None:
        """Waits until everything is acknowledged: at most this long, less if the hub is away."""
        seen = time.monotonic()
        ends = seen + seconds
        while self.unacknowledged:
            now = time.monotonic()
            if self._requester.has_server:
                seen = now
            if now >= min(ends, seen + _AWAY):
                break
            self._inserts.wait(0, min(_PAUSE, ends - now))

    def poll(self) -> Ack | None:
        """Asks whether to go on; returns the answer, None if none came.

        The replay answers once the learner has caught up, at the latest after 1 s.

        Raises:
            InputError: there was no hub for longer than the patience.
        """
        answer = None
        try:
            self.last_ack = answer = Ack.decode(self._requester.request(b"").result().payload)
        except Unanswered:
            pass
        except MessageError as error:
            self._member.warn(f"the replay gave a malformed reply: {error}")
        self._look_for_hub()
        if answer is None:
            self._member.stop.wait(_PAUSE)
        return answer

    def _look_for_hub(self) -> None:
        now = time.monotonic()
        if self._requester.has_server:
            self._missed_since = None
            self._absence.ends()
            return
        if self._missed_since is None:
            self._missed_since = now
        self._absence.lasts(now - self._missed_since)

    def _settle(self, outcome: Envelope | MessageError) -> None:
        """Counts a chunk that is stored, or refused for good."""
        try:
            if isinstance(outcome, MessageError):
                raise outcome
            self.last_ack = Ack.decode(outcome.payload)
            if self.last_ack.status == "refused":
                self.refused += 1
            else:
                self.acked += 1
        except MessageError as error:
            self.refused += 1
            malformed = "" if error is outcome else "a malformed reply: "
            self._member.warn(f"the replay refused a chunk: {malformed}{error}")
