"""Queries and controls of the connections to a hub's port, by the kernel; Zenoh has none."""

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
"""Offset of ``tcpi_bytes_received`` in Linux' ``struct tcp_info``."""

_MAX_FILES = 16_384
_ATTACH_FILTER, _DETACH_FILTER = 26, 27
"""Linux' ``SO_ATTACH_FILTER`` and ``SO_DETACH_FILTER``, for which Python has no names."""
_RETURN = 0x06
"""Instruction by which a packet filter says how many bytes of a packet the kernel keeps."""


def address_in(locator: str) -> Address:
    """Returns the other side's address in Zenoh's name of a link, such as
    ``tls/[fe80::1%2]:7447``, as the kernel has it: without the interface."""
    host, _, port = locator.partition("/")[2].rpartition(":")
    return host.strip("[]").partition("%")[0], int(port)


def most_files() -> int:
    """Returns how many files and connections this process may have open, after increasing the limit
    if it can.

    A hub needs thousands, and a process that may open no more fails wherever it opens one. Most
    systems allow 1,024, and more on request.
    """
    most, possible = resource.getrlimit(resource.RLIMIT_NOFILE)
    if most < (wanted := min(_MAX_FILES, possible)):
        most = wanted
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, possible))
    return most


def open_files() -> int:
    """Returns the number of open files of this process, or its limit if it cannot even look."""
    try:
        return len(os.listdir("/proc/self/fd"))
    except OSError:
        return resource.getrlimit(resource.RLIMIT_NOFILE)[0]


def forget_the_silent(port: int, milliseconds: int) -> None:
    """Lets the kernel end connections to ``port`` whose other side does not acknowledge data for so
    many ``milliseconds``.

    Zenoh writes to a TLS link to end it. If a router has forgotten the connection and the buffer is
    full, that write waits for the kernel's own timeout, a quarter of an hour, and the client cannot
    come back before. Sockets inherit the setting from the listening socket.
    """
    for found in _at(port):
        if _listens(found):
            found.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, milliseconds)


def bytes_received(port: int) -> dict[Address, int]:
    """Returns the bytes received over each connection to ``port`` since it began."""
    found = {}
    for address, opened in _accepted(port):
        with suppress(OSError):
            told = opened.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 256)
            (found[address],) = _RECEIVED.unpack_from(told, _RECEIVED_AT)
    return found


def ignore_connections(port: int, addresses: set[Address]) -> None:
    """Lets the kernel drop, unread, what comes from these addresses to ``port`` from now on.

    The data is not acknowledged, so the other side soon waits until the connection is ended.
    """
    for address, opened in _accepted(port):
        if address in addresses:
            _keep(opened, 1)  # the kernel keeps TCP's whole header, so acknowledgements count


def end_connections(port: int, addresses: set[Address]) -> None:
    """Ends the connections of these addresses to ``port``, for both sides."""
    for address, opened in _accepted(port):
        if address in addresses:
            _keep_all(opened)  # or a side that waits for buffer space would never see the end
            with suppress(OSError):  # if the other side was faster
                opened.shutdown(socket.SHUT_RDWR)


class Door:
    """The sockets at which this process accepts connections to ``port``.

    It keeps them open, because a process that may open no more files could not look for them.
    """

    def __init__(self, port: int, most_waiting: int) -> None:
        """``most_waiting`` is the maximum number of connections that wait to be accepted."""
        # `socket.dup` would make both sockets blocking.
        numbers = [os.dup(found.fileno()) for found in _at(port) if _listens(found)]
        self._listening = [socket.socket(fileno=number) for number in numbers]
        for each in self._listening:
            each.listen(most_waiting)

    def shut(self) -> None:
        """Drops requests for connections; clients ask again a second later."""
        for each in self._listening:
            _keep(each, 0)

    def open(self) -> None:
        """Accepts connections again."""
        for each in self._listening:
            _keep_all(each)

    def close(self) -> None:
        """Releases the sockets."""
        for each in self._listening:
            each.close()


def _keep(opened: socket.socket, count: int) -> None:
    """Lets the kernel keep ``count`` bytes of each incoming packet; does nothing if the socket has
    ended."""
    program = ctypes.create_string_buffer(struct.pack("=HBBI", _RETURN, 0, 0, count), 8)
    told = struct.pack("@HP", 1, ctypes.addressof(program))
    with suppress(OSError):
        opened.setsockopt(socket.SOL_SOCKET, _ATTACH_FILTER, told)


def _keep_all(opened: socket.socket) -> None:
    with suppress(OSError):  # if it has no filter
        opened.setsockopt(socket.SOL_SOCKET, _DETACH_FILTER, 0)


def _listens(opened: socket.socket) -> bool:
    return bool(opened.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN))


def _accepted(port: int) -> Iterator[tuple[Address, socket.socket]]:
    for opened in _at(port):
        with suppress(OSError):  # if it listens, or has ended
            host, other, *_ = opened.getpeername()
            yield (host, other), opened


def _at(port: int) -> Iterator[socket.socket]:
    """Yields this process' sockets at ``port``; each is closed when the next is taken."""
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
