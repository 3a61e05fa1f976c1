"""Pages over HTTP: what they say, who is let in, and that nobody can hold up a run."""

import contextlib
import os
import re
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest.mock import Mock

import pytest
from starlette.responses import FileResponse
from starlette.types import ASGIApp

from benchmarks.child import free_endpoint
from common.errors import InputError
from common.process import http_server
from common.process.http_endpoints import check_address, http_endpoints
from common.process.http_page import Page, verdict
from common.process.http_server import HttpServer, application, may_be_asked_as
from tests.http_get import get
from tests.patience import PATIENCE, wait_until


def fail() -> Page:
    raise ValueError("a mistake")


PAGES: dict[str, Callable[[], Page]] = {
    "/healthz": lambda: verdict([]),
    "/readyz": lambda: verdict(["it starts", "it is tired"]),
    "/mistake": fail,
}


@pytest.fixture
def address() -> Iterator[str]:
    address = free_endpoint().removeprefix("tcp/")
    with http_endpoints(address, lambda: PAGES):
        yield address


def test_pages_by_their_paths(address: str) -> None:
    assert get(address, "/healthz") == (200, "ok\n")
    assert get(address, "/healthz?verbose") == (200, "ok\n")
    assert get(address, "/healthz", "HEAD") == (200, "")
    assert get(address, "/readyz") == (503, "it starts\nit is tired\n")
    assert get(address, "/") == (404, "not found; there are /healthz, /readyz, /mistake\n")
    assert get(address, "/healthz", "POST")[0] == 405


def test_a_page_that_fails_is_no_reason_to_end(
    address: str, caplog: pytest.LogCaptureFixture
) -> None:
    assert get(address, "/mistake") == (500, "it cannot be shown: see the log\n")
    assert "/mistake cannot be shown: ValueError('a mistake')" in caplog.text
    assert get(address, "/healthz") == (200, "ok\n")


@pytest.mark.parametrize(
    ("host", "status"),
    [
        *(("evil.example", 421), ("localhost.evil.example:80", 421), ("", 421)),
        *(("localhost:18080", 200), ("[::1]:80", 200), ("192.0.2.7:80", 200)),
    ],
)
def test_only_who_means_this_host_is_answered(address: str, host: str, status: int) -> None:
    """A stranger's name that leads here (DNS rebinding) is none of ours."""
    assert get(address, "/healthz", Host=host)[0] == status


def test_the_name_that_it_listens_at_is_its_own() -> None:
    assert may_be_asked_as(["learner.example:8080"], "learner.example")
    assert may_be_asked_as([socket.gethostname()], "0.0.0.0")
    assert not may_be_asked_as(["learner.example:8080"], "0.0.0.0")
    assert not may_be_asked_as(["localhost", "localhost"], "0.0.0.0")
    assert not may_be_asked_as([], "0.0.0.0")


def test_beyond_loopback_any_name_will_do() -> None:
    port = free_endpoint().rpartition(":")[2]
    with http_endpoints(f"0.0.0.0:{port}", lambda: PAGES):
        assert get(f"127.0.0.1:{port}", "/healthz", Host="learner.cluster.example")[0] == 200


def test_those_who_connect_and_say_nothing_are_bounded(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http_server, "_MAX_CONNECTIONS", 8)
    before = threading.active_count()
    silent = [socket.create_connection(check_address(address), PATIENCE) for _ in range(20)]
    for each in silent[8:]:
        with contextlib.suppress(ConnectionResetError):
            assert each.recv(1) == b""  # there was no room
    assert threading.active_count() <= before
    for each in silent:
        each.close()

    def answers() -> bool:
        try:
            return get(address, "/healthz") == (200, "ok\n")
        except OSError:
            return False

    wait_until(answers, "there is room again")


def test_who_asks_a_byte_at_a_time_is_hung_up_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_server, "_SLOWEST", 0.3)
    address = free_endpoint().removeprefix("tcp/")
    with (
        http_endpoints(address, lambda: PAGES),
        socket.create_connection(check_address(address)) as slow,
    ):
        slow.settimeout(0.05)

        def hung_up() -> bool:
            try:
                slow.sendall(b"G")
                return slow.recv(1) == b""
            except TimeoutError:
                return False
            except OSError:
                return True

        wait_until(hung_up, "it is hung up on")
        assert get(address, "/healthz") == (200, "ok\n")


@pytest.mark.parametrize("streamed", [False, True])
def test_who_does_not_read_its_answer_is_cut_off(
    streamed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http_server, "_SLOWEST", 0.5)
    monkeypatch.setattr(http_server, "_SLOWEST_READER", 0.1)
    size = 2**26  # more than the system keeps for a reader
    film = tmp_path / "film.mp4"
    film.touch()
    os.truncate(film, size)
    host, port = check_address(free_endpoint().removeprefix("tcp/"))
    app: ASGIApp = application({"/large": lambda: Page(bytes(size))})
    server = HttpServer(FileResponse(film) if streamed else app, host, port, "--http")
    server.start()
    with contextlib.closing(server), socket.create_connection((host, port), PATIENCE) as slow:
        slow.sendall(b"GET /large HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert slow.recv(12) == b"HTTP/1.1 200"
        wait_until(lambda: not server._server.server_state.connections, "it is cut off")


@pytest.mark.parametrize(
    ("waiting", "cut_off"),
    [
        ([0, *[9] * 12], False),  # it took nothing for 55 s
        ([0, *[9] * 13], True),
        ([*range(99, 1, -1)], False),  # it is slow
        ([*[9] * 12, 8, *[8] * 11], False),
        ([0] * 99, False),  # the answer itself is slow
    ],
)
def test_a_reader_has_a_minute_for_each_piece(waiting: list[int], cut_off: bool) -> None:
    transport = Mock(is_closing=lambda: False)
    connection = object.__new__(http_server._Connection)
    connection.transport, connection.loop = transport, Mock()
    connection.cycle = Mock(response_complete=False)
    for size in waiting:
        transport.get_write_buffer_size.return_value = size
        connection._look()
    assert transport.abort.called == cut_off


ASKED = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n"


def say(address: str, words: bytes) -> bytes:
    """Returns all that is answered until it is hung up on."""
    with socket.create_connection(check_address(address), PATIENCE) as stranger:
        found = b""
        with contextlib.suppress(ConnectionError):  # it need not hear the rest
            stranger.sendall(words)
        with contextlib.suppress(ConnectionError):
            while some := stranger.recv(2**16):
                found += some
        return found


@pytest.mark.parametrize(
    "words",
    [
        *(b"GET /" + b"a" * 2**20 + b" HTTP/1.1\r\n\r\n", b"a" * 2**20, b"\x16\x03\x01" * 99),
        ASKED + b"".join(b"x%d: y\r\n" % number for number in range(100_000)) + b"\r\n",
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    ],
    ids=["long line", "no line", "TLS", "headers", "HTTP/2"],
)
def test_what_is_no_request_is_refused_and_others_are_answered(address: str, words: bytes) -> None:
    assert re.match(rb"HTTP/1.1 [45]|$", say(address, words))  # or it is only hung up on
    assert get(address, "/healthz") == (200, "ok\n")


def test_a_body_without_end_is_not_waited_for(address: str) -> None:
    said = ASKED.replace(b"GET", b"POST") + b"Content-Length: 100000000000\r\n\r\n"
    assert say(address, said).startswith(b"HTTP/1.1 405")
    assert get(address, "/healthz") == (200, "ok\n")


def test_requests_that_come_at_once_are_all_answered(address: str) -> None:
    told = say(address, (ASKED + b"\r\n") * 99 + ASKED + b"Connection: close\r\n\r\n")
    assert told.count(b"HTTP/1.1 200 OK") == 100


@pytest.mark.parametrize(
    "words",
    [
        *(b"GET /hea", ASKED, ASKED + b"Content-Length: 9\r\n\r\nab"),
        ASKED + b"Content-Length: 3\r\nTransfer-Encoding: chunked\r\n\r\nxxx",
    ],
)
def test_half_a_request_is_hung_up_on(words: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_server, "_SLOWEST", 0.1)
    address = free_endpoint().removeprefix("tcp/")
    with http_endpoints(address, lambda: PAGES):
        say(address, words)
        assert get(address, "/healthz") == (200, "ok\n")


def test_no_address_serves_nothing() -> None:
    with http_endpoints(None, lambda: pytest.fail("not asked for")):
        pass


@pytest.mark.parametrize(
    "address",
    ["9108", "127.0.0.1", "http://a:1", "a..b:1", f"{'a' * 64}:1"],
)
def test_what_is_no_address_is_told(address: str) -> None:
    with pytest.raises(InputError, match=r"write it as 127\.0\.0\.1:9108"):
        check_address(address)


@pytest.mark.parametrize("address", ["127.0.0.1:0", "a:99999"])
def test_what_is_no_port_is_told(address: str) -> None:
    with pytest.raises(InputError, match=f"^{address} has no valid port: choose one from 1 to"):
        check_address(address)


def test_an_address_that_is_taken_is_told(address: str) -> None:
    with (
        pytest.raises(InputError, match=r"cannot serve at .*choose another address with --http"),
        http_endpoints(address, lambda: PAGES),
    ):
        pass


def test_an_address_beyond_this_machine_is_warned_of(caplog: pytest.LogCaptureFixture) -> None:
    port = free_endpoint().rpartition(":")[2]
    with http_endpoints(f"0.0.0.0:{port}", lambda: PAGES):
        assert get(f"127.0.0.1:{port}", "/healthz") == (200, "ok\n")
    assert "whoever reaches http://0.0.0.0:" in caplog.text


@pytest.mark.parametrize(
    ("host", "reached"),
    [("0.0.0.0", socket.gethostname()), ("127.0.0.1", "127.0.0.1"), ("::1", "[::1]")],
)
def test_a_page_is_named_as_it_can_be_opened(host: str, reached: str) -> None:
    server = HttpServer(lambda *_: None, host, 0, "--web")  # type: ignore[arg-type]
    server.close()
    assert re.fullmatch(rf"http://{re.escape(reached)}:\d+/", server.url)


def test_ipv6() -> None:
    port = free_endpoint().rpartition(":")[2]
    with http_endpoints(f"[::1]:{port}", lambda: PAGES):
        assert get(f"[::1]:{port}", "/healthz") == (200, "ok\n")
