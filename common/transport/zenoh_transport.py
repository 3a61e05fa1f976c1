"""`ZenohTransport`: the verbs of `Transport` between machines, by a Zenoh session.

A star: one hub listens (the process that hosts the replay), all others are its clients. Shared
memory is off because it delivered corrupt data to stalled receivers; scouting is off and the
default address is loopback, so nothing is reachable from outside unless asked for. At addresses
that begin with ``tls/`` everybody shows a certificate, and may do what its role needs.
"""

import json
import logging
import os
import socket
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from typing import Any, Self, TypeVar

import zenoh
from zenoh.handlers import Callback, FifoChannel

from common.errors import InputError, MessageError, Unreachable
from common.process.threads import guarded
from common.transport.access_control import access_control, rate_limits, size_limits
from common.transport.checksum import DamagedMessage, seal, unseal
from common.transport.credentials import Role, allowed_actors, check_certificates
from common.transport.endpoint import check_endpoint, is_loopback
from common.transport.interface import (
    Answer,
    Closeable,
    Envelope,
    Publisher,
    Requester,
    Unanswered,
)
from common.transport.requests import LONGEST_ANSWER, PendingRequests, answer_request

MOST_SESSIONS = 4_096
"""Processes of all runs at one hub; Zenoh's own 1,000 would leave out the last of 1,024 actors."""
LEASE_MS = 3_000
"""Silence after which the other side counts as gone."""
_log = logging.getLogger(__name__)
_REFUSAL = "refusal"
"""Stands for a key in the checksum of a refusal, which has none."""
_SEAL = seal(_REFUSAL, b"")
_QUEUE = 4_096
"""Requests that may wait at a key: far more than the actors' windows together, because a full queue
blocks Zenoh's own receiving threads."""
_NOT_TRUSTED = (
    " If one runs there, its certificates or ours are of another authority or out of date, or the "
    "hub's are not for this address."
)


_T = TypeVar("_T", bound=Closeable)
_Heard = TypeVar("_Heard", zenoh.Sample, zenoh.Reply)


class ZenohTransport:
    """Implements `Transport`; made by `open_hub` and `connect`."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session
        self._declared: list[Closeable] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        for declared in self._declared:
            declared.close()
        self._declared.clear()
        if not self.session.is_closed():
            self.session.close()  # type: ignore[no-untyped-call]

    def serve(self, key: str, answer: Answer) -> Closeable:
        return self._keep(_Service(self.session, key, answer))

    def requester(self, key: str, deadline: float) -> Requester:
        return self._keep(_Requester(self.session, key, deadline))

    def gather(self, key: str, deadline: float, payload: bytes = b"") -> list[Envelope]:
        sealed = seal(key, payload)
        replies = self.session.get(key, timeout=deadline, payload=payload, attachment=sealed)
        found = (_envelope(reply.ok) for reply in replies if reply.ok is not None)
        return [each for each in found if each is not None]

    def publisher(self, key: str) -> Publisher:
        return self._keep(_Publisher(self.session, key))

    def subscribe(self, key: str, callback: Callable[[Envelope], None]) -> Closeable:
        def hear(sample: zenoh.Sample) -> None:
            if (envelope := _envelope(sample)) is not None:
                callback(envelope)

        handler = _callback(f"hear {key}", hear)
        return self._keep(_Declared(self.session.declare_subscriber(key, handler)))

    def announce(self, key: str) -> Closeable:
        return self._keep(_Declared(self.session.liveliness().declare_token(key)))

    def watch_presence(self, key: str, callback: Callable[[str, bool], None]) -> Closeable:
        def hear(sample: zenoh.Sample) -> None:
            callback(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        handler = _callback(f"watch {key}", hear)
        watch = self.session.liveliness().declare_subscriber(key, handler, history=True)
        return self._keep(_Declared(watch))

    def _keep(self, declared: _T) -> _T:
        self._declared.append(declared)
        return declared


def _callback(name: str, call: Callable[[_Heard], None], *end: Callable[[], None]) -> Any:
    """Returns a handler that Zenoh's own thread calls, and that ends the process if it fails."""
    return Callback(guarded(name, call), *(guarded(name, each) for each in end), indirect=False)


def _envelope(sample: zenoh.Sample) -> Envelope | None:
    """Returns what was published or answered; None if it is damaged."""
    key, payload = str(sample.key_expr), sample.payload.to_bytes()
    try:
        return Envelope(payload, unseal(key, payload, _bytes(sample.attachment)), key)
    except DamagedMessage as error:
        _log.warning("what came at %s is passed over: %s", key, error)
        return None


def _bytes(content: zenoh.ZBytes | None) -> bytes:
    return b"" if content is None else content.to_bytes()


class _Declared:
    """Anything of a session that can be undeclared."""

    def __init__(self, entity: Any) -> None:
        self._entity = entity
        self._closed = False

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._entity.undeclare()


class _Publisher(_Declared):
    """Implements `interface.Publisher`."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        super().__init__(
            session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP)
        )
        self._key = key

    def publish(self, payload: bytes, attachment: bytes = b"") -> None:
        self._entity.put(payload, attachment=seal(self._key, payload, attachment))


class _Request:
    """Implements `interface.Request`."""

    def __init__(self, query: zenoh.Query, served: str) -> None:
        """Raises DamagedMessage if it is not what was sent."""
        self._query = query
        self.key = str(query.key_expr)
        # At the server's own key: the client's may stand for those of several servers.
        self._reply_key = self.key if "*" in served else served
        self.payload = _bytes(query.payload)
        unseal(self.key, self.payload, _bytes(query.attachment))

    def reply(self, answer: bytes | Envelope) -> None:
        payload, attachment, _ = answer if isinstance(answer, Envelope) else Envelope(answer)
        with self._query as query:
            query.reply(
                self._reply_key, payload, attachment=seal(self._reply_key, payload, attachment)
            )

    def refuse(self, reason: str) -> None:
        with self._query as query:
            text = reason.encode()
            query.reply_err(seal(_REFUSAL, text) + text)

    def drop(self) -> None:
        self._query.drop()  # type: ignore[no-untyped-call]


class _Service(_Declared):
    """A queryable, and the thread that answers for it."""

    def __init__(self, session: zenoh.Session, key: str, answer: Answer) -> None:
        queryable = session.declare_queryable(key, FifoChannel(_QUEUE))
        super().__init__(queryable)

        def work() -> None:
            for query in queryable:
                try:
                    request = _Request(query, key)
                except DamagedMessage as error:
                    _log.warning("a request at %s is not answered: %s", key, error)
                    query.drop()  # type: ignore[no-untyped-call]
                    continue
                if self._closed:
                    request.drop()
                else:
                    answer_request(request, answer)
                del query, request  # one that is kept must end when its keeper lets it go

        self._thread = threading.Thread(target=work, name=f"serve {key}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop answering.

        A thread that still waits for Zenoh when the interpreter ends would bring the process down
        with "FATAL: exception not rethrown".
        """
        super().close()
        self._thread.join(LONGEST_ANSWER)


class _Requester:
    """Implements `interface.Requester`.

    Its querier lasts as long as the session: one that another thread asks cannot be undeclared.
    """

    def __init__(self, session: zenoh.Session, key: str, deadline: float) -> None:
        self._querier: Any = session.declare_querier(
            key,
            timeout=deadline,
            consolidation=zenoh.ConsolidationMode.NONE,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )
        self._pending = PendingRequests()
        self._key, self._name = key, f"ask {key}"

    @property
    def has_server(self) -> bool:
        # The status itself is always true.
        return bool(self._querier.matching_status.matching)

    def request(self, payload: bytes) -> Future[Envelope]:
        pending, future = self._pending, self._pending.begin()
        if future.done():
            return future

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                if (envelope := _envelope(reply.ok)) is not None:
                    pending.settle(future, envelope)
            elif reply.err is not None:
                sealed = reply.err.payload.to_bytes()
                checksum, text = sealed[: len(_SEAL)], sealed[len(_SEAL) :]
                # Without one it is Zenoh's own word that nobody answered, or damaged.
                if checksum == seal(_REFUSAL, text):
                    pending.settle(future, MessageError(text.decode(errors="replace")))

        def on_end() -> None:
            pending.settle(future, Unanswered("nobody answered"))

        sealed = seal(self._key, payload)
        handler = _callback(self._name, on_reply, on_end)
        self._querier.get(handler, payload=payload, attachment=sealed)
        return future

    def close(self) -> None:
        self._pending.close()


def _config(mode: str, settings: dict[str, Any]) -> zenoh.Config:
    config = zenoh.Config()
    settings = {
        "mode": mode,
        "listen/endpoints": [],
        "connect/endpoints": [],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,  # nobody is looked for, so there is nothing to wait for
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": LEASE_MS,
        # Of 64 KB each: a minibatch leaves in one go, not two at a time.
        "transport/link/tx/queue/size/data": 16,
        **settings,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def open_hub(endpoint: str, certificates: Path | None = None) -> ZenohTransport:
    """Listen at ``endpoint`` for all processes of the run.

    Args:
        certificates: folder with the hub's, for a ``tls/`` endpoint.

    Raises:
        InputError: the port is taken, the address is not one of this machine's, or the
            certificates cannot be used.
    """
    credentials = check_certificates(endpoint, certificates, "hub")
    host, port = check_endpoint(endpoint)
    if credentials is None and not is_loopback(host):
        _log.warning(
            "whoever reaches %s can send chunks and weights: use a tls/ address "
            "(deploy/README.md), or a network whose machines you trust",
            endpoint,
        )
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except OSError as error:
        another = f"{endpoint.rpartition(':')[0]}:{port + (1 if port < 65_535 else -1)}"
        raise InputError(
            f"cannot listen at {endpoint} ({error.strerror}): another learner or replay may be "
            f"running there; choose another address, as by --listen {another}."
        ) from None
    settings: dict[str, Any] = {
        "listen/endpoints": [endpoint],
        "transport/unicast/max_sessions": MOST_SESSIONS,
        "transport/unicast/accept_pending": MOST_SESSIONS,  # all may come at once, after a restart
        **size_limits(),
        "downsampling": rate_limits(),
    }
    if credentials is not None and certificates is not None:
        access = access_control(allowed_actors(certificates, listed=True))
        settings |= {**credentials.settings("hub"), "access_control": access}
    try:
        session = zenoh.open(_config("router", settings))
    except zenoh.ZError as error:
        raise InputError(f"cannot listen at {endpoint}: {error}") from None
    _forget_the_silent(port)
    return ZenohTransport(session)


def _forget_the_silent(port: int) -> None:
    """Let the kernel end connections to ``port`` whose other side has not taken what was sent.

    To end a TLS link Zenoh writes to it. Where a router has forgotten the connection, and its
    buffer is full, that would wait for the kernel's own end, a quarter of an hour later, and the
    client could not come back before. Sockets inherit it from the one that accepts them.
    """
    for file in Path("/proc/self/fd").iterdir():
        with suppress(OSError):
            if not os.readlink(file).startswith("socket:"):
                continue
            with socket.socket(fileno=os.dup(int(file.name))) as found:
                listens = found.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN)
                of_ip = found.family in (socket.AF_INET, socket.AF_INET6)
                if listens and of_ip and found.getsockname()[1] == port:
                    found.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, LEASE_MS)


def connect(
    endpoint: str,
    patience: float,
    stopped: Callable[[], bool] = lambda: False,
    *,
    role: Role = "actor",
    name: str | None = None,
    certificates: Path | None = None,
) -> ZenohTransport:
    """Join the hub at ``endpoint``, trying again for ``patience`` seconds.

    Args:
        name: of an actor, which may have a certificate of its own.
        certificates: folder with those of ``role``, for a ``tls/`` endpoint.

    Raises:
        InputError: nobody answered in that time, or the certificates cannot be used.
        KeyboardInterrupt: ``stopped`` became true.
    """
    credentials = check_certificates(endpoint, certificates, role, name)
    settings: dict[str, Any] = {
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 1000,
        "connect/exit_on_failure": True,
        "connect/retry": {
            "period_init_ms": 100,
            "period_max_ms": 500,
            "period_increase_factor": 2,
        },
    }
    if credentials is not None:
        settings |= credentials.settings(role)
    config = _config("client", settings)
    began = time.monotonic()
    while True:
        try:
            return ZenohTransport(zenoh.open(config))
        except zenoh.ZError:
            if stopped():
                raise KeyboardInterrupt from None
            waited = time.monotonic() - began
            if waited >= patience:
                raise Unreachable(
                    f"no hub answered at {endpoint} in {waited:.0f} s: start a learner "
                    "there, or name its address with --connect."
                    + ("" if credentials is None else _NOT_TRUSTED)
                ) from None
