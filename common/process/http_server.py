"""An HTTP server in a thread of its own, for monitoring systems and browsers. It is read-only."""

import asyncio
import ipaddress
import logging
import re
import socket
import threading
from collections.abc import Callable, Mapping, Sequence

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

from common.errors import InputError
from common.process.http_page import Page

_MAX_CONNECTIONS = 64
"""Maximum number of connections; further ones are closed."""
_SLOWEST = 5.0
"""Seconds after which a connection without a request is closed."""
_SLOWEST_READER = 60.0
"""Seconds after which a connection is cut off if nothing of its answer is read any more."""
_FAREWELL = 5
"""Seconds that answers under way have when the server closes."""
_WRONG_HOST = (
    "ask for this page by an IP address, localhost, the host's own name, or the one it listens at\n"
)
"""Answer, with status 421, to a request that `may_be_asked_as` rejects."""
_HEADERS = {
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; media-src 'self'; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cache-control": "no-store",
}
"""Headers of every answer, which restrict what a browser may do with it."""
_EVERYWHERE = ("0.0.0.0", "::")
_log = logging.getLogger(__name__)


class HttpServer:
    """A server that listens once it is made, and answers from `start` to `close`. Raises InputError
    if it cannot listen at the address.

    Args:
        flag: the flag that asked for the server, such as ``--web``.
        any_name: answer requests by any name of the host; see `may_be_asked_as`.
    """

    def __init__(
        self, app: ASGIApp, host: str, port: int, flag: str, *, any_name: bool = False
    ) -> None:
        name = f"[{host}]" if ":" in host else host
        try:
            family, _, _, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
            self._socket = socket.create_server(place[:2], family=family)
        except OSError as error:
            raise InputError(
                f"cannot serve at {name}:{port} ({error.strerror}): choose another address with "
                f"{flag}."
            ) from None
        # No other machine can open an address that stands for all of this one's.
        reached = socket.gethostname() if host in _EVERYWHERE else name
        self.url = f"http://{reached}:{self._socket.getsockname()[1]}/"
        self._server = uvicorn.Server(
            uvicorn.Config(
                _guarded(app, None if any_name else host),
                http=_Connection,
                ws="none",
                loop="asyncio",
                lifespan="off",
                log_config=None,
                log_level="error",  # what strangers send is no concern of the person who trains
                access_log=False,
                server_header=False,
                headers=list(_HEADERS.items()),
                proxy_headers=False,
                timeout_graceful_shutdown=_FAREWELL,
            )
        )
        self._thread = threading.Thread(target=self._serve, name=flag.strip("-"), daemon=True)

    def start(self) -> None:
        """Begins to answer requests, in a thread."""
        self._thread.start()

    def close(self) -> None:
        """Stops listening and answering; answers under way have some seconds to finish."""
        self._server.should_exit = True
        if self._thread.is_alive():
            self._thread.join(2 * _FAREWELL)
        self._socket.close()

    def _serve(self) -> None:
        self._server.run(sockets=[self._socket])
        if not self._server.should_exit:
            raise RuntimeError(f"the server at {self.url} ended")


class _Connection(H11Protocol):
    """A connection that is closed when it is idle, because too many open files would end a run."""

    _last: RequestResponseCycle | None = None
    _unread = 0
    """Bytes of answers that waited for their reader at the last look."""
    _stalled = 0
    """Number of looks in a row at which as many waited as at the one before."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        if len(self.connections) > _MAX_CONNECTIONS:
            transport.abort()
        else:
            self.loop.call_later(_SLOWEST, self._look)

    def _look(self) -> None:
        """Closes the connection, unless there was a request since the last look, or one is being
        answered. Cuts it off, closed or not, if its reader has stalled."""
        last, self._last = self._last, self.cycle
        if self.cycle is last and (last is None or last.response_complete):
            self.transport.close()
        before, self._unread = self._unread, self.transport.get_write_buffer_size()
        self._stalled = self._stalled + 1 if self._unread == before else 0
        if self._unread and self._stalled >= _SLOWEST_READER / _SLOWEST:
            self.transport.abort()
        elif self._unread or not self.transport.is_closing():
            self.loop.call_later(_SLOWEST, self._look)


def _guarded(app: ASGIApp, host: str | None) -> ASGIApp:
    """Returns ``app``, which rejects requests for other hosts than ``host``, unless it is None."""

    async def guarded(scope: Scope, receive: Receive, send: Send) -> None:
        told = [value.decode("latin-1") for name, value in scope["headers"] if name == b"host"]
        meant = host is None or may_be_asked_as(told, host)
        answer: ASGIApp = app if meant else PlainTextResponse(_WRONG_HOST, 421)
        await answer(scope, receive, send)

    return guarded


def may_be_asked_as(told: Sequence[str], host: str) -> bool:
    """Whether a browser that sends the Host headers ``told`` meant this server at ``host``.

    A stranger's page may point its own name to our address (DNS rebinding), and could then read our
    answers as its own. A request by IP address cannot be such an attack.
    """
    if len(told) != 1:
        return False
    asked = re.sub(r":\d*$", "", told[0].strip()).strip("[]").lower()
    try:
        ipaddress.ip_address(asked)
    except ValueError:
        return asked in {"localhost", host.lower(), socket.gethostname().lower()}
    return True


def application(pages: Mapping[str, Callable[[], Page]]) -> ASGIApp:
    """Returns the application that serves ``pages`` by their paths."""

    def show(request: Request) -> Response:
        path = request.url.path
        if path not in pages:
            return PlainTextResponse(f"not found; there are {', '.join(pages)}\n", 404)
        try:
            page = pages[path]()
        except Exception as error:
            _log.warning("%s cannot be shown: %r", path, error)
            return PlainTextResponse("it cannot be shown: see the log\n", 500)
        return Response(page.body, page.status, {"content-type": page.kind})

    return Starlette(routes=[Route("/{path:path}", show)])
