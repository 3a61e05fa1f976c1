"""Sends chunks so that none is lost: acknowledged inserts, a window of them under way.

An insert is a Zenoh query; its reply is the acknowledgement. A query without a reply (the server
is away, or too slow) leaves its chunk to be sent again; the server drops what it has already.
"""

import threading
import time
from collections.abc import Callable
from typing import Any

import zenoh
from zenoh.handlers import Callback

from common.errors import InputError, MessageError
from common.protocol.ack import Ack

ACK_TIMEOUT = 5.0
"""Seconds after which an insert without an answer is sent again."""
_PAUSE = 0.2


class _PendingInsert:
    """A chunk on its way; ``lost`` when its query ended without an answer."""

    def __init__(self, payload: bytes) -> None:
        self.payload = payload
        self.lost = False


class InsertClient:
    """At most ``window`` chunks unacknowledged; `send` waits for room.

    Args:
        key: the actor's own insert key.
        patience: seconds without a hub after which waiting is given up.
        stopped: tells that the process wants to leave, which ends every wait.
        warn: takes a sentence for people.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        window: int,
        *,
        patience: float,
        stopped: Callable[[], bool],
        warn: Callable[[str], None],
    ) -> None:
        self.made = 0
        self.acked = 0
        self.retried = 0
        self.refused = 0
        self.last_ack: Ack | None = None
        self._window = window
        self._patience = patience
        self._missed_since: float | None = None
        self._stopped = stopped
        self._warn = warn
        self._letters: list[_PendingInsert] = []  # unacknowledged, oldest first
        self._changed = threading.Condition()
        self._querier = session.declare_querier(
            key,
            timeout=ACK_TIMEOUT,
            consolidation=zenoh.ConsolidationMode.NONE,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )

    @property
    def unacknowledged(self) -> int:
        return len(self._letters)

    def post(self, payload: bytes) -> None:
        """Send one encoded chunk without waiting for room."""
        letter = _PendingInsert(payload)
        with self._changed:
            self._letters.append(letter)
        self.made += 1
        self._post(letter)
        self._resend()

    def send(self, payload: bytes) -> None:
        """Send one encoded chunk, and wait until the window has room for the next.

        Raises:
            InputError: there was no hub for longer than the patience.
        """
        self.post(payload)
        while len(self._letters) >= self._window and not self._stopped():
            self._resend()
            self._look_for_hub()
            with self._changed:
                self._changed.wait_for(lambda: len(self._letters) < self._window, _PAUSE)

    def flush(self, seconds: float) -> None:
        """Wait at most this long until all is acknowledged."""
        deadline = time.monotonic() + seconds
        while self._letters and time.monotonic() < deadline:
            self._resend()
            with self._changed:
                self._changed.wait_for(lambda: not self._letters, _PAUSE)

    def poll(self) -> Ack | None:
        """Ask whether to go on: answered once the learner has caught up, at the latest after 1 s.

        None when nobody answers.

        Raises:
            InputError: there was no hub for longer than the patience.
        """
        for reply in self._querier.get(payload=b""):
            if reply.ok is not None:
                try:
                    self.last_ack = Ack.decode(reply.ok.payload.to_bytes())
                except MessageError as error:
                    self._warn(f"the replay gave an answer that is none: {error}")
                    continue
                return self.last_ack
        self._look_for_hub()
        with self._changed:
            self._changed.wait(_PAUSE)
        return None

    @property
    def _hub_is_there(self) -> bool:
        # The status itself is always true; and its type is declared wrongly.
        return bool(self._querier.matching_status.matching)  # type: ignore[attr-defined]

    def _look_for_hub(self) -> None:
        now = time.monotonic()
        if self._hub_is_there:
            self._missed_since = None
        elif self._missed_since is None:
            self._missed_since = now
        elif now - self._missed_since > self._patience:
            raise InputError(
                f"the hub went away and did not come back in {self._patience:.0f} s: "
                "start it again with --resume, then start this actor."
            )

    def _resend(self) -> None:
        """Send the lost letters again, unless nobody listens: that would come back at once."""
        lost = [letter for letter in self._letters if letter.lost]
        if lost and self._hub_is_there:
            for letter in lost:
                self.retried += 1
                self._post(letter)

    def _post(self, letter: _PendingInsert) -> None:
        letter.lost = False
        settled = False

        def on_reply(reply: zenoh.Reply) -> None:
            nonlocal settled
            settled = self._settle(letter, reply)

        def on_end() -> None:
            if not settled:
                with self._changed:
                    letter.lost = True
                    self._changed.notify_all()

        handler: Any = Callback(on_reply, on_end, indirect=False)
        self._querier.get(handler, payload=letter.payload)

    def _settle(self, letter: _PendingInsert, reply: zenoh.Reply) -> bool:
        """Take ``letter`` off the list if it is stored, or refused for good; whether it is."""
        refusal: str | None = None
        ack: Ack | None = None
        if reply.ok is not None:
            try:
                ack = Ack.decode(reply.ok.payload.to_bytes())
            except MessageError as error:
                refusal = f"an answer that is none ({error})"
        elif reply.err is not None:
            text = reply.err.payload.to_bytes().decode(errors="replace")
            if text == "Timeout":  # Zenoh's own word for a query that nobody answered
                return False
            refusal = text
        with self._changed:
            if letter not in self._letters:
                return True  # answered twice: it had been sent again too early
            self._letters.remove(letter)
            if ack is not None:
                self.acked += 1
                self.last_ack = ack
            else:
                self.refused += 1
            self._changed.notify_all()
        if refusal is not None:
            self._warn(f"the replay refused a chunk: {refusal}")
        return True
