"""What a hub asks of the kernel about the connections to its port, which Zenoh does not tell."""

import ctypes
import os
import resource
import socket
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

Address = tuple[str, int]
"""Host and port of the other side."""
_RECEIVED = struct.Struct("=Q")
_RECEIVED_AT = 128
"""Where Linux' ``struct tcp_info`` has ``tcpi_bytes_received``."""

_MOST_FILES = 16_384
_ATTACH_FILTER, _DETACH_FILTER = 26, 27
"""Linux' ``SO_ATTACH_FILTER`` and ``SO_DETACH_FILTER``, which Python does not name."""
_RETURN = 0x06
"""Instruction by which a packet filter says how many bytes of what comes the kernel keeps."""


def address_in(locator: str) -> Address:
    """Returns the other side's address in what Zenoh calls a link, ``tls/[fe80::1%2]:7447``, as the
    kernel tells it: without the interface."""
    host, _, port = locator.partition("/")[2].rpartition(":")
    return host.strip("[]").partition("%")[0], int(port)


def most_files() -> int:
    """Returns how many files and connections this process may have open.

    A hub needs thousands, and a process that has no more fails wherever it opens one. It has 1,024
    on most systems, and more if it asks.
    """
    most, possible = resource.getrlimit(resource.RLIMIT_NOFILE)
    if most < (wanted := min(_MOST_FILES, possible)):
        most = wanted
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, possible))
    return most


def open_files() -> int:
    """Returns how many this process has open; all it may have where it cannot even look."""
    try:
        return len(os.listdir("/proc/self/fd"))
    except OSError:
        return resource.getrlimit(resource.RLIMIT_NOFILE)[0]


def forget_the_silent(port: int, milliseconds: int) -> None:
    """Let the kernel end connections to ``port`` whose other side has not taken what was sent.

    To end a TLS link Zenoh writes to it. Where a router has forgotten the connection, and its
    buffer is full, that would wait for the kernel's own end, a quarter of an hour later, and the
    client could not come back before. Sockets inherit it from the one that accepts them.
    """
    for found in _at(port):
        if _listens(found):
            found.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, milliseconds)


def bytes_received(port: int) -> dict[Address, int]:
    """Returns what came over each connection to ``port`` since it began."""
    found = {}
    for address, opened in _accepted(port):
        with suppress(OSError):
            told = opened.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 256)
            (found[address],) = _RECEIVED.unpack_from(told, _RECEIVED_AT)
    return found


def ignore_connections(port: int, addresses: set[Address]) -> None:
    """Drops what comes from these addresses to ``port`` from now on, in the kernel, unread.

    The other side's words are not acknowledged: it soon waits, until the connection is ended.
    """
    for address, opened in _accepted(port):
        if address in addresses:
            _keep(opened, 1)  # and of TCP the whole header, so that acknowledgements count


def end_connections(port: int, addresses: set[Address]) -> None:
    """Ends the connections of these addresses to ``port``, for both sides."""
    for address, opened in _accepted(port):
        if address in addresses:
            _keep_all(opened)  # or who waits for room in its buffer is never told of the end
            with suppress(OSError):  # the other side was faster
                opened.shutdown(socket.SHUT_RDWR)


class Door:
    """The sockets at which this process takes connections to ``port``.

    It holds them, since who has no file left could not look for them.
    """

    def __init__(self, port: int, most_waiting: int) -> None:
        """Let so many connections wait there at most until they are taken."""
        # `dup` of a socket would have it wait, for both.
        numbers = [os.dup(found.fileno()) for found in _at(port) if _listens(found)]
        self._listening = [socket.socket(fileno=number) for number in numbers]
        for each in self._listening:
            each.listen(most_waiting)

    def shut(self) -> None:
        """Drop what asks for a connection, which asks again a second later."""
        for each in self._listening:
            _keep(each, 0)

    def open(self) -> None:
        """Take connections again."""
        for each in self._listening:
            _keep_all(each)

    def close(self) -> None:
        """Hold them no longer."""
        for each in self._listening:
            each.close()


def _keep(opened: socket.socket, count: int) -> None:
    """Lets the kernel keep so many bytes of each packet that comes, unless the socket is at its
    end."""
    program = ctypes.create_string_buffer(struct.pack("=HBBI", _RETURN, 0, 0, count), 8)
    told = struct.pack("@HP", 1, ctypes.addressof(program))
    with suppress(OSError):
        opened.setsockopt(socket.SOL_SOCKET, _ATTACH_FILTER, told)


def _keep_all(opened: socket.socket) -> None:
    with suppress(OSError):  # nothing of it is dropped
        opened.setsockopt(socket.SOL_SOCKET, _DETACH_FILTER, 0)


def _listens(opened: socket.socket) -> bool:
    return bool(opened.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN))


def _accepted(port: int) -> Iterator[tuple[Address, socket.socket]]:
    for opened in _at(port):
        with suppress(OSError):  # it listens, or is at its end
            host, other, *_ = opened.getpeername()
            yield (host, other), opened


def _at(port: int) -> Iterator[socket.socket]:
    """Yields this process' own ends at ``port``, each for as long as it is looked at."""
    for file in Path("/proc/self/fd").iterdir():
        with suppress(OSError):
            if not os.readlink(file).startswith("socket:"):
                continue
            copy = os.dup(int(file.name))
            try:
                found = socket.socket(fileno=copy)
            except OSError:  # the number is another file's by now
                os.close(copy)
                continue
            with found:
                of_ip = found.family in (socket.AF_INET, socket.AF_INET6)
                if of_ip and found.getsockname()[1] == port:
                    yield found
