"""``--http``: pages of a process for monitoring systems.

``/healthz`` says whether the process works, ``/readyz`` whether its run is as it should be, and
``/metrics`` gives its figures. People can read the pages too.
"""

import logging
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager

from common.endpoint import host_and_port, is_loopback
from common.errors import InputError
from common.process.extras import extra_for
from common.process.http_page import Page

_log = logging.getLogger(__name__)
HTTP_PORT = 9108
"""Usual port of ``--http``."""


def check_address(
    address: str, flag: str = "--http", usual: str = f"127.0.0.1:{HTTP_PORT}", least_port: int = 1
) -> tuple[str, int]:
    """Returns host and port. Raises InputError if it is not an address.

    Args:
        flag: the flag that takes the address.
        usual: an example, shown in the error.
        least_port: 0 if any free port will do.
    """
    found = host_and_port(address, least_port)
    if found is None:
        raise InputError(f"{address!r} is not an address for {flag}: write it as {usual}.")
    return found


@contextmanager
def http_endpoints(
    address: str | None, pages: Callable[[], dict[str, Callable[[], Page]]]
) -> Iterator[None]:
    """Serves ``pages`` by their paths, from a thread of its own; does nothing without an address.
    Raises InputError if the address is malformed or taken, or a package is missing.

    Args:
        pages: called only if there is an address.
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
    # Beyond loopback, a monitoring system may reach us by any name that its network has for us.
    server = HttpServer(app, host, port, "--http", any_name=not local)
    with closing(server):
        server.start()
        yield
