"""`Transport`: the verbs by which the processes of a run communicate.

`zenoh_transport` implements them between machines; the tests have a transport between objects of
one process. `chosen` says which one the programs use. Keys are paths such as ``ale-robot/r/job``.
``*`` stands for one part of a key, and ``**`` for any number of parts.
"""

from collections.abc import Callable
from concurrent.futures import Future
from typing import NamedTuple, Protocol, Self


class Unanswered(Exception):
    """A request ended without an answer: there is no server, or none answered by the deadline."""


class Envelope(NamedTuple):
    """An answer or a publication."""

    payload: bytes
    attachment: bytes = b""
    """Data that is needed before the payload is read, such as its version."""
    key: str = ""
    """Key at which it was published or answered; the transport fills it in."""


class Request(Protocol):
    """A request as its server sees it; the first call of `reply`, `refuse` or `drop` ends it."""

    @property
    def key(self) -> str:
        """The key at which the client asked."""

    @property
    def size(self) -> int:
        """Size of the payload, bytes; known without reading it."""

    @property
    def payload(self) -> bytes:
        """What the client sent. Raises DamagedMessage if it was damaged on its way."""

    def reply(self, answer: bytes | Envelope) -> None:
        """Answers the request."""

    def refuse(self, reason: str) -> None:
        """Tells the client that asking again is useless."""

    def drop(self) -> None:
        """Ends the request without an answer, so that the client may ask again."""


Answer = Callable[[Request], bytes | Envelope | None]
"""Returns the reply, or None if it has kept the request and will end it later.

The client gets a `MessageError` as a refusal. Any other exception is logged, and the request is
dropped: the message is not at fault, so its sender should keep it.
"""


class Closeable(Protocol):
    """Something declared at a transport, until it is closed; closing it twice does no harm."""

    def close(self) -> None: ...


class Requester(Closeable, Protocol):
    """Sends requests to one key. It is thread-safe."""

    @property
    def has_server(self) -> bool:
        """Whether a server is known at the key. Without one, a request ends at once, unanswered."""

    def request(self, payload: bytes) -> Future[Envelope]:
        """Sends ``payload`` and returns the future answer; several requests may be under way.

        The future ends by the requester's deadline, or when the requester is closed, at the latest.
        It raises `Unanswered`, or `MessageError` with the server's reason if the server refused.
        Its callbacks run on a thread of the transport, so they must be brief and must not call the
        transport. A server answers one client's requests in the order in which they were sent.
        """


class Publisher(Closeable, Protocol):
    """Publishes at one key; what a slow subscriber cannot take is dropped."""

    def publish(self, payload: bytes, attachment: bytes = b"") -> None: ...


class Transport(Closeable, Protocol):
    """The connection of one process to all others of the run; as a context manager, it closes.

    Closing it closes all that was declared there. Callbacks run on a thread of the transport: they
    must be brief, and must not call the transport. A callback that raises ends the process, like a
    thread that dies (`common.process.threads`), so it must catch errors in what strangers send.
    """

    def serve(self, key: str, answer: Answer) -> Closeable:
        """Answers requests at ``key`` on a thread of its own, in the order in which they come.

        ``key`` may hold ``*``. If more requests wait than the queue holds, the oldest end
        unanswered. Closing the service drops waiting requests, and waits for the one that is being
        answered.
        """

    def requester(self, key: str, deadline: float) -> Requester:
        """Returns a requester at ``key`` whose requests wait ``deadline`` seconds for an answer."""

    def gather(self, key: str, deadline: float, payload: bytes = b"") -> list[Envelope]:
        """Returns the answers of all servers at ``key``, which may hold ``*``, without refusals.

        Args:
            deadline: seconds to wait for servers that do not answer.
            payload: the request to each of them.
        """

    def publisher(self, key: str) -> Publisher:
        """Returns a publisher at ``key``."""

    def subscribe(self, key: str, callback: Callable[[Envelope], None]) -> Closeable:
        """Calls ``callback`` with each publication at ``key``, which may hold ``*``."""

    def announce(self, key: str) -> Closeable:
        """Announces presence at ``key`` until the result is closed, or this process dies."""

    def watch_presence(self, key: str, callback: Callable[[str, bool], None]) -> Closeable:
        """Calls ``callback`` with a key whenever a process there is present (True) or has gone
        (False).

        Processes that are already present are reported at once. ``key`` may hold ``*``.
        """

    def note_over_quota(self, name: str) -> None:
        """Notes that a request of actor or evaluator ``name`` was not taken, because it sends too
        many. A hub may cut off who does so all the time."""

    def watch_shut_out(self, callback: Callable[[str, str], None]) -> Closeable:
        """Calls ``callback`` with name and address of each process that connects and is shut out.

        At a hub, these are processes whose certificates the hub does not admit. There are none
        elsewhere, or without certificates.
        """

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...
