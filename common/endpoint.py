"""Addresses of a hub, such as ``tcp/127.0.0.1:7447``."""

import ipaddress
import re
import socket

from common.errors import InputError

_LAST_PORT = 65_535
DEFAULT_PORT = 7447
DEFAULT_ENDPOINT = f"tcp/127.0.0.1:{DEFAULT_PORT}"
_ADDRESS = re.compile(r"(\[[0-9a-fA-F:]+\]|[^\[\]:/\s]+):(\d{1,9})")


def check_endpoint(endpoint: str) -> tuple[str, int]:
    """Returns host and port of ``endpoint``. Raises InputError if it is not an address."""
    scheme, _, address = endpoint.partition("/")
    found = host_and_port(address)
    if scheme not in ("tcp", "tls") or found is None:
        meant = DEFAULT_ENDPOINT if host_and_port(endpoint) is None else f"tcp/{endpoint}"
        raise InputError(f"{endpoint!r} is not an address: write it as {meant}.")
    return found


def host_and_port(address: str, least_port: int = 1) -> tuple[str, int] | None:
    """Returns the parts of ``HOST:PORT`` or ``[IPv6]:PORT``; None if the form is another. Raises
    InputError if there is no such port."""
    found = _ADDRESS.fullmatch(address)
    if found is None:
        return None
    if not least_port <= int(found[2]) <= _LAST_PORT:
        raise InputError(
            f"{address} has no valid port: choose one from {least_port} to {_LAST_PORT}."
        )
    try:
        found[1].encode("idna")  # as Python does when it looks up a host
    except UnicodeError:
        return None
    return found[1].strip("[]"), int(found[2])


def check_free(host: str, port: int) -> None:
    """Checks that a process can listen at ``host`` and ``port`` now. Raises OSError if not."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((host, port))


def is_known(host: str) -> bool:
    """Whether this machine finds an address of ``host``."""
    try:
        return bool(socket.getaddrinfo(host, None))
    except (OSError, UnicodeError):
        return False


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches ``host``."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def from_here(endpoint: str) -> str:
    """Returns the address by which this machine's processes reach a hub listening at
    ``endpoint``."""
    for every, own in (("0.0.0.0", "127.0.0.1"), ("[::]", "[::1]")):
        endpoint = endpoint.replace(f"/{every}:", f"/{own}:")
    return endpoint
