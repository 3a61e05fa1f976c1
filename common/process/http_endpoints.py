"""``--http``: what a monitoring system asks a process, over HTTP.

``/healthz`` says whether the process works, ``/readyz`` whether its run is as it should be, and
``/metrics`` gives its figures. It is a page for machines that a person can read too.
"""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from typing import NamedTuple

from common.errors import InputError
from common.process.extras import extra_for
from common.transport.endpoint import host_and_port, is_loopback

_log = logging.getLogger(__name__)


class Page(NamedTuple):
    """What a path shows."""

    body: bytes
    kind: str = "text/plain; charset=utf-8"
    status: int = 200


def verdict(reasons: Sequence[str]) -> Page:
    """Returns ``ok``, or with status 503 the reasons why not, a line each."""
    if not reasons:
        return Page(b"ok\n")
    return Page("".join(f"{reason}\n" for reason in reasons).encode(), status=503)


def check_address(
    address: str, flag: str = "--http", usual: str = "127.0.0.1:9108", least_port: int = 1
) -> tuple[str, int]:
    """Returns host and port. Raises InputError if it is not an address.

    Args:
        flag: what asks for an address, such as the ``usual`` one.
        least_port: 0 where any free port will do.
    """
    found = host_and_port(address, least_port)
    if found is None:
        raise InputError(f"{address!r} is no address for {flag}: write it as {usual}.")
    return found


@contextmanager
def http_endpoints(
    address: str | None, pages: Callable[[], dict[str, Callable[[], Page]]]
) -> Iterator[None]:
    """Serves ``pages`` by their paths, from a thread of its own; nothing where there is no address.
    Raises InputError if the address is none, or taken, or a package is missing.

    Args:
        pages: made only if they are served.
    """
    if address is None:
        yield
        return
    host, port = check_address(address)
    local = is_loopback(host)
    if not local:
        _log.warning("whoever reaches http://%s can read the figures of this process", address)
    with extra_for("--http", "ops"):
        from common.process.http_server import HttpServer, application

        app = application(pages())
    # Beyond loopback a monitoring system has whatever name for us its network gives.
    server = HttpServer(app, host, port, "--http", any_name=not local)
    with closing(server):
        server.start()
        yield
