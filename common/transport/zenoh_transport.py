"""`ZenohTransport`: implements `Transport` between machines, by a Zenoh session."""

import logging
from collections.abc import Callable, Set
from contextlib import AbstractContextManager, ExitStack
from typing import TypeVar

import zenoh
from zenoh.handlers import FifoChannel

from common.transport.access_control import LONGEST_RECEIVED
from common.transport.checksum import seal
from common.transport.credentials import common_name
from common.transport.flood_guard import FloodGuard
from common.transport.hub_sockets import Address, address_in, end_connections
from common.transport.interface import Answer, Closeable, Envelope, Publisher, Requester
from common.transport.link_watch import LinkWatch
from common.transport.zenoh_entities import (
    Declared,
    Service,
    ZenohPublisher,
    ZenohRequester,
    callback_of,
    envelope_of,
)

_MAX_UNREAD = 4
"""Maximum number of unread answers; senders of more have to wait."""
_log = logging.getLogger(__name__)
_T = TypeVar("_T", bound=Closeable)


class ZenohTransport(AbstractContextManager["ZenohTransport"]):
    """Implements `Transport`; made by `zenoh_sessions`."""

    def __init__(
        self,
        session: zenoh.Session,
        let_in: Set[str] | None = None,
        guard: FloodGuard | None = None,
        *,
        connects: bool = False,
    ) -> None:
        """Args:
        let_in: names in certificates that this hub admits; None if it does not check.
        guard: ends the connections of who floods this hub, and is closed with it.
        connects: whether this is a client, which connects again if its connection ends.
        """
        self.session = session
        self._let_in = let_in
        self._declared: list[Closeable] = []
        self._guard = guard and self.keep(guard)
        self._watch = self.keep(LinkWatch(self._end_links)) if connects else None

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        with ExitStack() as end:  # callbacks run in reverse order, each even if another one fails
            end.callback(self._close_session)
            for declared in reversed(self._declared):
                end.callback(declared.close)
            self._declared.clear()

    def _close_session(self) -> None:
        if not self.session.is_closed():
            try:
                self.session.close()  # type: ignore[no-untyped-call]
            except zenoh.ZError as error:  # closing thousands of connections takes too long
                _log.warning("the others find out by themselves that this process ends: %s", error)

    def serve(self, key: str, answer: Answer) -> Closeable:
        return self.keep(Service(self.session, key, answer))

    def requester(self, key: str, deadline: float) -> Requester:
        return self.keep(ZenohRequester(self.session, key, deadline, self._watch))

    def gather(self, key: str, deadline: float, payload: bytes = b"") -> list[Envelope]:
        sealed = seal(key, payload)
        replies = self.session.get(
            key,
            FifoChannel(_MAX_UNREAD),
            timeout=deadline,
            payload=payload,
            attachment=sealed,
            consolidation=zenoh.ConsolidationMode.NONE,  # or Zenoh would hold all until the last
        )
        found: list[Envelope] = []
        size = 0
        for reply in replies:
            if reply.ok is not None and (answer := envelope_of(reply.ok)) is not None:
                found.append(answer)
                size += len(answer.payload)
            if size > LONGEST_RECEIVED:  # a server may answer without end
                text = "no more than %d bytes of answers at %s are taken"
                _log.warning(text, LONGEST_RECEIVED, key)
                break
        return found

    def publisher(self, key: str) -> Publisher:
        return self.keep(ZenohPublisher(self.session, key))

    def subscribe(self, key: str, callback: Callable[[Envelope], None]) -> Closeable:
        def hear(sample: zenoh.Sample) -> None:
            if (envelope := envelope_of(sample)) is not None:
                callback(envelope)

        handler = callback_of(f"hear {key}", hear)
        return self.keep(Declared(self.session.declare_subscriber(key, handler)))

    def announce(self, key: str) -> Closeable:
        return self.keep(Declared(self.session.liveliness().declare_token(key)))

    def watch_presence(self, key: str, callback: Callable[[str, bool], None]) -> Closeable:
        def hear(sample: zenoh.Sample) -> None:
            callback(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        handler = callback_of(f"watch {key}", hear)
        watch = self.session.liveliness().declare_subscriber(key, handler, history=True)
        return self.keep(Declared(watch))

    def watch_shut_out(self, callback: Callable[[str, str], None]) -> Closeable:
        def hear(name: str, address: Address, present: bool) -> None:
            if self._let_in is not None and present and name not in self._let_in:
                callback(name, address[0])

        return self.watch_links(hear)

    def note_over_quota(self, name: str) -> None:
        if self._guard is not None:
            self._guard.note_over_quota(common_name("actor", name))

    def watch_links(self, callback: Callable[[str, Address, bool], None]) -> Closeable:
        """Calls ``callback`` with the name in a connection's certificate, the other side's address,
        and whether the connection begins (True) or has ended (False)."""

        def hear(event: zenoh.LinkEvent) -> None:
            if (name := event.link.auth_identifier) is not None:
                present = event.kind == zenoh.SampleKind.PUT
                callback(name, address_in(event.link.dst), present)

        handler = callback_of("hear of links", hear)
        links = self.session.info.declare_link_events_listener(handler, history=True)
        return self.keep(Declared(links))

    def _end_links(self) -> bool:
        """Ends this process's connections; a client's session then connects again. Returns whether
        there were any."""
        try:
            links = self.session.info.links()
            for link in links:
                _, port = address_in(link.src)
                end_connections(port, {address_in(link.dst)})
        except (OSError, zenoh.ZError):  # no more files may be open, or the session has closed
            return False
        return bool(links)

    def keep(self, declared: _T) -> _T:
        """Returns ``declared``, which is closed with this transport."""
        self._declared.append(declared)
        return declared
