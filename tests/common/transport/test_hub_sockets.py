"""What a hub asks of the kernel, on plain sockets."""

import errno
import fcntl
import os
import resource
import socket
import struct
import termios
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress

import pytest

from common.transport.hub_sockets import (
    Address,
    Door,
    address_in,
    bytes_received,
    end_connections,
    forget_the_silent,
    ignore_connections,
    open_files,
)
from tests.patience import PATIENCE, wait_until


@pytest.mark.parametrize(
    ("locator", "address"),
    [
        ("tls/192.0.2.7:7447", ("192.0.2.7", 7447)),
        ("tls/[2001:db8::1]:1", ("2001:db8::1", 1)),
        ("tls/[::ffff:192.0.2.7]:2", ("::ffff:192.0.2.7", 2)),
        ("tls/[fe80::1%2]:3", ("fe80::1", 3)),  # in one's own network
    ],
)
def test_zenoh_and_the_kernel_mean_the_same_address(locator: str, address: Address) -> None:
    assert address_in(locator) == address


def test_the_kernel_ends_a_hubs_connections_whose_other_side_takes_nothing() -> None:
    """Or a client whose connection a router forgot could not come back over TLS."""

    def timeout(opened: socket.socket) -> int:
        return opened.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT)

    with (
        socket.create_server(("127.0.0.1", 0)) as ours,
        socket.create_server(("127.0.0.1", 0)) as other,
    ):
        before = os.listdir("/proc/self/fd")
        forget_the_silent(ours.getsockname()[1], 3_000)
        assert len(os.listdir("/proc/self/fd")) == len(before)
        assert (timeout(ours), timeout(other)) == (3_000, 0)
        with socket.create_connection(ours.getsockname()):
            accepted, _ = ours.accept()
            with accepted:
                assert timeout(accepted) == 3_000


def test_a_file_that_took_a_sockets_number_is_left_as_it_was(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(os, "readlink", lambda _: "socket:[1]")
    before = os.listdir("/proc/self/fd")
    assert not bytes_received(1)
    assert len(os.listdir("/proc/self/fd")) == len(before)


Connection = tuple[socket.socket, socket.socket]


@contextmanager
def two_connections() -> Iterator[tuple[int, Connection, Connection]]:
    """A port and both sides of two connections to it, theirs first."""
    with (
        socket.create_server(("127.0.0.1", 0)) as ours,
        socket.create_connection(ours.getsockname()) as first,
        socket.create_connection(ours.getsockname()) as second,
        ours.accept()[0] as accepted,
        ours.accept()[0] as still,
    ):
        yield ours.getsockname()[1], (first, accepted), (second, still)


def test_what_came_over_each_connection_is_known_and_one_of_them_can_be_ended() -> None:
    with (
        two_connections() as (port, (first, accepted), (second, still)),
        socket.create_server(("127.0.0.1", 0)) as other,
        socket.create_connection(other.getsockname()),
        other.accept()[0],
    ):
        before = os.listdir("/proc/self/fd")
        first.sendall(bytes(1_000))
        accepted.recv(1_000, socket.MSG_WAITALL)
        assert bytes_received(port) == {first.getsockname(): 1_000, second.getsockname(): 0}
        end_connections(port, {first.getsockname()})
        assert first.recv(1) == b""  # the end
        second.sendall(b"x")
        assert still.recv(1) == b"x"
        assert bytes_received(port)[second.getsockname()] == 1
        assert len(os.listdir("/proc/self/fd")) == len(before)


def test_what_an_ignored_connection_says_is_not_received_and_it_can_still_be_ended() -> None:
    """Also where it waits for room: it would wait for the kernel's own end, minutes later."""

    def unacknowledged(opened: socket.socket) -> int:
        told = fcntl.ioctl(opened, termios.TIOCOUTQ, bytes(4))
        return int.from_bytes(told, "little")

    with two_connections() as (port, (first, accepted), (second, still)):
        name = first.getsockname()
        ignore_connections(port, {name})
        first.setblocking(False)
        with suppress(BlockingIOError):
            while first.send(bytes(2**16)):  # until there is no more room
                pass
        second.sendall(b"x")
        assert still.recv(1) == b"x"
        assert bytes_received(port) == {name: 0, second.getsockname(): 1}
        accepted.sendall(b"y")
        wait_until(lambda: not unacknowledged(accepted), "what the hub says arrives")
        first.settimeout(PATIENCE)
        end_connections(port, {name})
        assert first.recv(2) == b"y"
        with pytest.raises(ConnectionError):
            first.sendall(b"z")


def test_who_comes_to_a_shut_door_is_not_heard_before_it_is_open() -> None:
    with socket.create_server(("127.0.0.1", 0)) as ours, socket.socket() as early:
        before = os.listdir("/proc/self/fd")
        door = Door(ours.getsockname()[1], 8)
        door.shut()
        early.setblocking(False)
        with suppress(BlockingIOError):
            early.connect(ours.getsockname())
        door.open()
        with socket.create_connection(ours.getsockname()) as late:
            ours.settimeout(PATIENCE)
            for each in (late, early):  # which asks again after a second
                accepted, address = ours.accept()
                with accepted:
                    assert address == each.getsockname()
        door.close()
        assert len(os.listdir("/proc/self/fd")) == len(before)


def test_no_more_wait_at_a_door_than_are_told() -> None:
    with socket.create_server(("127.0.0.1", 0), backlog=100) as ours, ExitStack() as stack:
        Door(ours.getsockname()[1], 3).close()
        guests = [stack.enter_context(socket.socket()) for _ in range(8)]
        for guest in guests:
            guest.setblocking(False)
            with suppress(BlockingIOError):
                guest.connect(ours.getsockname())
        told = ours.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 64)
        waiting, most = struct.unpack_from("=II", told, 24)  # of who listens
        assert (waiting, most) == (4, 3)  # Linux lets one more wait


def test_open_files_are_counted_also_where_none_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    before = open_files()
    with socket.socket(), socket.socket():
        assert open_files() == before + 2

    def none_left(_: str) -> list[str]:
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    monkeypatch.setattr(os, "listdir", none_left)
    assert open_files() == resource.getrlimit(resource.RLIMIT_NOFILE)[0]
