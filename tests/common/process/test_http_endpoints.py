"""Pages over HTTP: what they say, who is let in, and that nobody can hold up a run."""

import socket
import threading
from collections.abc import Callable, Iterator

import pytest

from benchmarks.child import free_endpoint
from common.errors import InputError
from common.process import http_endpoints as module
from common.process.http_endpoints import (
    Page,
    check_address,
    http_endpoints,
    may_be_asked_as,
    verdict,
)
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
    assert get(address, "/healthz", "POST")[0] == 501


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


def test_those_who_connect_and_say_nothing_are_bounded(address: str) -> None:
    before = threading.active_count()
    silent = [socket.create_connection(check_address(address), PATIENCE) for _ in range(20)]
    for each in silent[module._AT_ONCE :]:
        assert each.recv(1) == b""  # there was no room
    assert threading.active_count() - before <= module._AT_ONCE
    for each in silent:
        each.close()

    def answers() -> bool:
        try:
            return get(address, "/healthz") == (200, "ok\n")
        except OSError:
            return False

    wait_until(answers, "there is room again")


def test_a_connection_for_which_there_is_no_thread_takes_nobodys_place(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def start(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "start", start)
        for _ in range(module._AT_ONCE):
            with socket.create_connection(check_address(address), PATIENCE) as connection:
                assert connection.recv(1) == b""
    assert get(address, "/healthz") == (200, "ok\n")


def test_who_asks_a_byte_at_a_time_is_hung_up_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_SLOWEST", 0.3)
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


def test_no_address_serves_nothing() -> None:
    with http_endpoints(None, lambda: pytest.fail("not asked for")):
        pass


@pytest.mark.parametrize("address", ["9108", "127.0.0.1", "127.0.0.1:0", "http://a:1", "a:99999"])
def test_what_is_no_address_is_told(address: str) -> None:
    with pytest.raises(InputError, match=r"write it as 127\.0\.0\.1:9108"):
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


def test_ipv6() -> None:
    port = free_endpoint().rpartition(":")[2]
    with http_endpoints(f"[::1]:{port}", lambda: PAGES):
        assert get(f"[::1]:{port}", "/healthz") == (200, "ok\n")
