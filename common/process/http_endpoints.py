"""``--http``: what a monitoring system asks a process, over HTTP.

``/healthz`` says whether the process works, ``/readyz`` whether its run is as it should be, and
``/metrics`` gives its figures. It is a page for machines that a person can read too.
"""

import ipaddress
import logging
import re
import socket
import socketserver
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, NamedTuple

from common.errors import InputError
from common.transport.endpoint import host_and_port, is_loopback

_AT_ONCE = 8
"""Connections that are served at a time; one more is closed."""
_SLOWEST = 5.0
"""Seconds that a client may take to ask and to read, all in all."""
_log = logging.getLogger(__name__)

TEXT = "text/plain; charset=utf-8"
WRONG_HOST = (
    "ask for this page by an IP address, localhost, the host's own name, or the one it listens at\n"
)
"""What is answered, with status 421, where `may_be_asked_as` says no."""


class Page(NamedTuple):
    """What a path shows."""

    body: bytes
    kind: str = TEXT
    status: int = 200


def verdict(reasons: Sequence[str]) -> Page:
    """Returns ``ok``, or with status 503 the reasons why not, a line each."""
    if not reasons:
        return Page(b"ok\n")
    return Page("".join(f"{reason}\n" for reason in reasons).encode(), status=503)


def check_address(
    address: str, flag: str = "--http", usual: str = "127.0.0.1:9108", least_port: int = 1
) -> tuple[str, int]:
    """Returns host and port.

    Args:
        flag: what asks for an address, such as the ``usual`` one.
        least_port: 0 where any free port will do.

    Raises:
        InputError: it is not an address.
    """
    found = host_and_port(address, least_port)
    if found is None:
        raise InputError(f"{address!r} is no address for {flag}: write it as {usual}.")
    return found


def may_be_asked_as(told: Sequence[str], host: str) -> bool:
    """Whether a browser that asks with the Host headers ``told`` meant us, who listen at ``host``.

    A stranger's page may have its own name lead to our address (DNS rebinding), and then read us
    as itself; a number leads nowhere else.
    """
    if len(told) != 1:
        return False
    asked = re.sub(r":\d*$", "", told[0].strip()).strip("[]").lower()
    try:
        ipaddress.ip_address(asked)
    except ValueError:
        return asked in {"localhost", host.lower(), socket.gethostname().lower()}
    return True


@contextmanager
def http_endpoints(
    address: str | None, pages: Callable[[], dict[str, Callable[[], Page]]]
) -> Iterator[None]:
    """Serves ``pages`` by their paths, from threads of its own; nothing where there is no address.

    Args:
        pages: made only if they are served.

    Raises:
        InputError: the address is none, or taken.
    """
    if address is None:
        yield
        return
    host, port = check_address(address)
    if not is_loopback(host):
        _log.warning("whoever reaches http://%s can read the figures of this process", address)
    try:
        server = _Server((host, port), pages())
    except OSError as error:
        raise InputError(
            f"cannot serve at {address} ({error.strerror}): choose another address with --http."
        ) from None
    thread = threading.Thread(target=server.serve_forever, args=(0.1,), name="http", daemon=True)
    thread.start()
    try:
        yield
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    request_queue_size = 16

    def __init__(self, place: tuple[str, int], pages: dict[str, Callable[[], Page]]) -> None:
        self.host = place[0]
        self.pages = pages
        self._open: dict[Any, float] = {}
        """Requests that are served, and until when."""
        if ":" in place[0]:
            self.address_family = socket.AF_INET6
        super().__init__(place, _Handler)

    def server_bind(self) -> None:
        # Not `HTTPServer`'s, which asks a name server for the host's name.
        socketserver.TCPServer.server_bind(self)

    def process_request(self, request: Any, client_address: Any) -> None:
        if len(self._open) < _AT_ONCE:
            self._open[request] = time.monotonic() + _SLOWEST
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def shutdown_request(self, request: Any) -> None:
        self._open.pop(request, None)
        super().shutdown_request(request)

    def service_actions(self) -> None:
        """Hang up on the slow; a timeout of the socket would begin anew with each byte."""
        for request, end in list(self._open.items()):
            if time.monotonic() > end:
                with suppress(OSError):  # the client was faster
                    request.shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that hangs up, or a page that fails, is no reason to end a run."""
        _log.debug("a request over HTTP failed", exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    server_version, sys_version = "ale-robot", ""

    def do_GET(self) -> None:
        assert isinstance(self.server, _Server)
        pages = self.server.pages
        path = self.path.partition("?")[0]
        told, host = self.headers.get_all("Host", []), self.server.host
        # Beyond loopback a monitoring system has whatever name for us its network gives.
        if is_loopback(host) and not may_be_asked_as(told, host):
            page = Page(WRONG_HOST.encode(), status=421)
        elif path not in pages:
            page = Page(f"not found; there are {', '.join(pages)}\n".encode(), status=404)
        else:
            try:
                page = pages[path]()
            except Exception as error:
                _log.warning("%s cannot be shown: %r", path, error)
                page = Page(b"it cannot be shown: see the log\n", status=500)
        self.send_response(page.status)
        self.send_header("Content-Type", page.kind)
        self.send_header("Content-Length", str(len(page.body)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(page.body)

    do_HEAD = do_GET

    def log_message(self, format: str, *args: Any) -> None:
        """Nobody wants a line for each scrape."""
