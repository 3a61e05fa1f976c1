"""`Transport`: the verbs by which the processes of a run speak to each other.

`zenoh_transport` carries them between machines, and the tests' own between the objects of one
process. Keys are paths such as ``ale-robot/r/task``; ``*`` stands for one part of a key and ``**``
for any number of them.
"""

from collections.abc import Callable
from concurrent.futures import Future
from typing import NamedTuple, Protocol, Self


class Unanswered(Exception):
    """A request ended without an answer: no server is there, or none answered by the deadline."""


class Envelope(NamedTuple):
    """An answer or a publication."""

    payload: bytes
    attachment: bytes = b""
    """What should be known before the payload is read, such as its version."""
    key: str = ""
    """Where it was published or answered; filled in by the transport."""


class Request(Protocol):
    """A request as its server sees it; it ends with the first call of one of the three methods."""

    @property
    def key(self) -> str:
        """The key at which the client asked."""

    @property
    def size(self) -> int:
        """Bytes of the payload, known without reading it."""

    @property
    def payload(self) -> bytes:
        """What the client sent. Raises DamagedMessage if it is not that any more."""

    def reply(self, answer: bytes | Envelope) -> None:
        """Answer it."""

    def refuse(self, reason: str) -> None:
        """Tell the client that asking again is of no use."""

    def drop(self) -> None:
        """End it without an answer, so that the client may ask again."""


Answer = Callable[[Request], bytes | Envelope | None]
"""Returns what to reply, or None if it has kept the request and ends it later.

The client gets a `MessageError` as a refusal. Any other exception is logged and the request
dropped: the message is not at fault, so its sender should keep it.
"""


class Closeable(Protocol):
    """What was declared at a transport, until it is closed; closing it twice does no harm."""

    def close(self) -> None: ...


class Requester(Closeable, Protocol):
    """Sends requests to one key; safe for several threads."""

    @property
    def has_server(self) -> bool:
        """Whether a server is known at the key. A request to none ends at once, unanswered."""

    def request(self, payload: bytes) -> Future[Envelope]:
        """Send ``payload`` and return the answer to come; several requests may be under way.

        The future ends by the requester's deadline, or when the requester is closed, at the latest.
        It raises `Unanswered`, or `MessageError` with the server's reason if that refused. Its
        callbacks run on a thread of the transport, so they must be brief and must not call it.
        A server answers one client's requests in the order in which they were sent.
        """


class Publisher(Closeable, Protocol):
    """Tells whoever listens at one key; what a slow listener cannot take is dropped."""

    def publish(self, payload: bytes, attachment: bytes = b"") -> None: ...


class Transport(Closeable, Protocol):
    """One process' way to all others of the run; a context manager that closes it.

    Closing it closes all that was declared there. Callbacks run on a thread of the transport: they
    must be brief, and must not call the transport. One that raises ends the process, as a thread
    that dies does (`common.process.threads`): what strangers may send is for it to catch.
    """

    def serve(self, key: str, answer: Answer) -> Closeable:
        """Answer requests at ``key`` on a thread of their own, in the order in which they come.

        ``key`` may hold ``*``. Where more wait than its queue holds, the oldest end unanswered.
        Closing it drops what waits there, and waits for the request that is being answered.
        """

    def requester(self, key: str, deadline: float) -> Requester:
        """Return a sender of requests to ``key`` that waits ``deadline`` seconds for an answer."""

    def gather(self, key: str, deadline: float, payload: bytes = b"") -> list[Envelope]:
        """Return all servers' answers at ``key``, which may hold ``*``; refusals are left out.

        Args:
            deadline: seconds to wait for servers that do not answer.
            payload: what each of them is asked.
        """

    def publisher(self, key: str) -> Publisher:
        """Return a publisher at ``key``."""

    def subscribe(self, key: str, callback: Callable[[Envelope], None]) -> Closeable:
        """Call ``callback`` with all that is published at ``key``, which may hold ``*``."""

    def announce(self, key: str) -> Closeable:
        """Show presence at ``key`` until it is closed, or this process dies."""

    def watch_presence(self, key: str, callback: Callable[[str, bool], None]) -> Closeable:
        """Call ``callback`` with a key at which somebody is present (True) or no longer (False).

        Those who are present already are told at once. ``key`` may hold ``*``.
        """

    def watch_shut_out(self, callback: Callable[[str, str], None]) -> Closeable:
        """Call ``callback`` with name and address of each process that connects to do nothing.

        At a hub these are those whose certificates name nobody that it lets in. Elsewhere, and
        where nobody has certificates, there are none.
        """

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...
