"""Serves the page over HTTP from a thread of its own; nothing can be changed through it.

It is another server than that of ``--http`` (`common.process.http_endpoints`), which hangs up on
everybody after seconds and needs no package: a browser keeps its connections and asks for parts of
films.
"""

import asyncio
import base64
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

from common.actions import KEYS_OF_ACTION
from common.errors import InputError
from common.process.http_endpoints import WRONG_HOST, may_be_asked_as
from common.protocol.live_view import LiveView

_PAGE = Path(__file__).parent / "page"
_MOST_CONNECTIONS = 64
"""One more is closed."""
_SLOWEST = 5.0
"""Seconds after which a connection that asks nothing is closed."""
_FAREWELL = 5
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

State = Callable[[int, int], dict[str, Any]]
"""Returns what the page shows, with the points of its curves after those that it has."""
View = Callable[[str, str, int, str], LiveView | None]
"""Returns what an actor shows, by role, name, environment and viewpoint; None where it shows
nothing. Raises ValueError if there is no such actor."""
Film = Callable[[str], Path | None]
"""Returns the film of that name."""


class PageServer:
    """Listens from its making on, and answers from `start` to `close`.

    Raises InputError if nobody can listen there.
    """

    def __init__(self, host: str, port: int, state: State, view: View, film: Film) -> None:
        try:
            family, _, _, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
            self._socket = socket.create_server(place[:2], family=family)
        except OSError as error:
            raise InputError(
                f"the page cannot be served at {host}:{port} ({error.strerror}): choose another "
                "--web."
            ) from None
        self.port: int = self._socket.getsockname()[1]
        name = f"[{host}]" if ":" in host else host
        self.url = f"http://{name}:{self.port}/"
        self._server = uvicorn.Server(
            uvicorn.Config(
                _Guarded(_application(state, view, film), host),
                http=_Connection,
                ws="none",
                loop="asyncio",
                lifespan="off",
                log_config=None,
                log_level="error",  # what strangers send is no warning to whoever trains
                access_log=False,
                server_header=False,
                proxy_headers=False,
                timeout_graceful_shutdown=_FAREWELL,
            )
        )
        self._thread = threading.Thread(target=self._serve, name="web", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._server.should_exit = True
        if self._thread.is_alive():
            self._thread.join(2 * _FAREWELL)
        self._socket.close()

    def _serve(self) -> None:
        self._server.run(sockets=[self._socket])
        if not self._server.should_exit:
            raise RuntimeError("the server of the page ended")


class _Connection(H11Protocol):
    """A connection that cannot be held for nothing: files that are open end a run when they are
    too many."""

    _last: RequestResponseCycle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        if len(self.connections) > _MOST_CONNECTIONS:
            transport.abort()
        else:
            self.loop.call_later(_SLOWEST, self._look)

    def _look(self) -> None:
        """Close, unless something was asked since the last look, or is being answered."""
        last, self._last = self._last, self.cycle
        if self.cycle is last and (last is None or last.response_complete):
            self.transport.close()
        if not self.transport.is_closing():
            self.loop.call_later(_SLOWEST, self._look)


class _Guarded:
    """Turns away whoever asks for another host, and adds what a browser must keep to."""

    def __init__(self, app: ASGIApp, host: str) -> None:
        self._app = app
        self._host = host

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        told = [value.decode("latin-1") for name, value in scope["headers"] if name == b"host"]
        answer: ASGIApp = self._app
        if not may_be_asked_as(told, self._host):
            answer = PlainTextResponse(WRONG_HOST, 421)

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                added = [(name.encode(), value.encode()) for name, value in _HEADERS.items()]
                message["headers"] = [*message["headers"], *added]
            await send(message)

        await answer(scope, receive, send_with_headers)


def _application(state: State, view: View, film: Film) -> Starlette:
    def give_state(request: Request) -> Response:
        return JSONResponse(state(_number(request, "thinned"), _number(request, "count")))

    def give_view(request: Request) -> Response:
        path, viewpoint = request.path_params, request.query_params.get("viewpoint", "none")
        try:
            shown = view(path["role"], path["name"], _number(request, "stream", 0), viewpoint)
        except ValueError:
            return PlainTextResponse("there is no such view", 404)
        return JSONResponse(None if shown is None else _plain(shown))

    def give_film(request: Request) -> Response:
        found = film(request.path_params["name"])
        return (
            PlainTextResponse("there is no such film", 404)
            if found is None
            else FileResponse(found)
        )

    return Starlette(
        routes=[
            Route("/state", give_state),
            Route("/view/{role}/{name}", give_view),
            Route("/films/{name}", give_film),
            Mount("/", StaticFiles(directory=_PAGE, html=True)),
        ]
    )


def _number(request: Request, name: str, default: int = -1) -> int:
    told = request.query_params.get(name, "")
    return int(told) if told.isascii() and told.isdigit() and len(told) < 10 else default


def _plain(view: LiveView) -> dict[str, Any]:
    """Returns a view with the keys of its actions, and its pictures as addresses of their own data,
    which stay encoded."""
    pictures = {
        name: f"data:image/jpeg;base64,{base64.b64encode(jpeg).decode()}" if jpeg else ""
        for name, jpeg in vars(view).items()
        if isinstance(jpeg, bytes)
    }
    keys = [int(KEYS_OF_ACTION[action]) for action in view.actions]
    return {**vars(view), **pictures, "keys": keys}
