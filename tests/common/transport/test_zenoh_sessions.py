"""Opening the hub and joining it, by Zenoh."""

import errno
import os
import resource
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import cycle
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
import zenoh

from common.endpoint import DEFAULT_ENDPOINT, check_endpoint, is_loopback
from common.errors import InputError, Unreachable
from common.protocol.run_keys import RunKeys
from common.protocol.wire import MAX_MESSAGE_BYTES
from common.transport import hub_sockets, zenoh_entities, zenoh_sessions, zenoh_transport
from common.transport.access_control import MAX_SESSIONS
from common.transport.checksum import seal
from common.transport.interface import Envelope, Request, Unanswered
from common.transport.zenoh_sessions import LEASE_MS, connect, open_hub
from common.transport.zenoh_transport import ZenohTransport
from tests.patience import PATIENCE, wait_until


@pytest.mark.parametrize(
    "endpoint",
    [
        "",
        "127.0.0.1:7447",
        "tcp/127.0.0.1",
        "tcp/:7447",
        "tcp/127.0.0.1:port",
        "tcp/::1:7447",
        "tcp/a b:7447",
        "udp/127.0.0.1:7447",
        "tcp/127.0.0.1:7447/",
        "tcp//127.0.0.1:7447",
    ],
)
def test_what_is_no_address_is_told_with_an_example(endpoint: str) -> None:
    for use in (check_endpoint, open_hub, lambda endpoint: connect(endpoint, 1e9)):
        with pytest.raises(InputError, match=f"is not an address: write it as {DEFAULT_ENDPOINT}"):
            use(endpoint)


@pytest.mark.parametrize("endpoint", ["tcp/127.0.0.1:0", "tcp/127.0.0.1:65536"])
def test_neither_hub_nor_client_takes_what_is_no_port(endpoint: str) -> None:
    for use in (open_hub, lambda endpoint: connect(endpoint, 1e9)):
        with pytest.raises(InputError, match="has no valid port: choose one from 1 to 65535"):
            use(endpoint)


def ip_sockets() -> dict[str, tuple[socket.SocketKind, Any, int]]:
    """Kind of this process' IP sockets; of those that listen also address and timeout."""
    found: dict[str, tuple[socket.SocketKind, Any, int]] = {}
    for file in Path("/proc/self/fd").iterdir():
        with suppress(OSError):
            name = os.readlink(file)
            if not name.startswith("socket:"):
                continue
            with socket.socket(fileno=os.dup(int(file.name))) as opened:
                if opened.family not in (socket.AF_INET, socket.AF_INET6):
                    continue
                found[name] = (opened.type, None, 0)
                if opened.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN):
                    timeout = opened.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT)
                    found[name] = (opened.type, opened.getsockname(), timeout)
    return found


def test_a_hub_alone_listens_at_its_address_alone_and_nobody_is_looked_for(endpoint: str) -> None:
    before = ip_sockets()
    with open_hub(endpoint), connect(endpoint, PATIENCE):
        opened = [each for name, each in ip_sockets().items() if name not in before]
    assert {kind for kind, *_ in opened} == {socket.SOCK_STREAM}, "UDP is for multicast"
    listening = [(address, timeout) for _, address, timeout in opened if address]
    assert listening == [(check_endpoint(endpoint), LEASE_MS)]


@pytest.fixture
def few_files() -> Iterator[int]:
    """This process may have so many open files until it asks for more."""
    most, possible = resource.getrlimit(resource.RLIMIT_NOFILE)
    few = 1_024
    resource.setrlimit(resource.RLIMIT_NOFILE, (few, possible))
    yield few
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, possible))


def test_a_hub_asks_for_as_many_files_as_it_needs(
    few_files: int, endpoint: str, caplog: pytest.LogCaptureFixture
) -> None:
    with open_hub(endpoint):
        most, possible = resource.getrlimit(resource.RLIMIT_NOFILE)
        assert most == min(16_384, possible) > few_files
    assert ("takes at most" in caplog.text) == (most * 3 // 8 < MAX_SESSIONS)


def test_a_hub_that_gets_few_files_takes_fewer_processes_and_says_so(
    few_files: int, endpoint: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(hub_sockets, "_MAX_FILES", 8)
    monkeypatch.setattr(zenoh_sessions, "MAX_SESSIONS", 400)
    with open_hub(endpoint):
        assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] == few_files
    told = f"{endpoint} takes at most 384 processes, because this one may have 1024 open files"
    assert told in caplog.text


def test_whoever_does_not_fit_is_not_let_in(endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zenoh_sessions, "most_files", lambda: 3)
    with (
        open_hub(endpoint),
        connect(endpoint, PATIENCE),
        pytest.raises(Unreachable),
        connect(endpoint, 0.0),
    ):
        pass


def test_a_port_that_is_taken_is_told_and_the_next_one_named(endpoint: str) -> None:
    next_one = f"tcp/127.0.0.1:{check_endpoint(endpoint)[1] + 1}"
    sentence = rf"^cannot listen at {endpoint} .* by --listen {next_one}\.$"
    with (
        socket.create_server(check_endpoint(endpoint)),
        pytest.raises(InputError, match=sentence),
    ):
        open_hub(endpoint)


def test_two_hubs_cannot_share_an_address(zenoh_hub: ZenohTransport, endpoint: str) -> None:
    with pytest.raises(InputError, match=f"^cannot listen at {endpoint}"):
        open_hub(endpoint)


def test_an_address_can_be_used_again_at_once(endpoint: str) -> None:
    for _ in range(2):
        hub = open_hub(endpoint)
        try:
            client = connect(endpoint, PATIENCE)
            client.close()
        finally:
            hub.close()


def test_a_hub_that_fails_as_it_begins_leaves_nothing_open(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(zenoh_sessions, "FileGuard", Mock(side_effect=OSError("no file")))
        with pytest.raises(OSError, match="no file") as error:
            open_hub(endpoint)
    open_hub(endpoint).close()
    del error  # until here, the failed call's variables were alive


def test_whatever_fails_to_close_keeps_nothing_else_open() -> None:
    session, last = Mock(is_closed=lambda: False), Mock()
    transport = ZenohTransport(session)
    transport.keep(Mock(close=Mock(side_effect=zenoh.ZError("no"))))
    transport.keep(last)
    with pytest.raises(zenoh.ZError):
        transport.close()
    assert last.close.called
    assert session.close.called


def test_an_address_of_another_machine_is_told() -> None:
    # 192.0.2.0/24 is nobody's (RFC 5737).
    with pytest.raises(InputError) as refused:
        open_hub("tcp/192.0.2.1:7447")
    assert str(refused.value) == (
        "cannot listen at tcp/192.0.2.1:7447: 192.0.2.1 is not an address of this machine; choose "
        "one that is, or listen at all of them by --listen tcp/0.0.0.0:7447."
    )


def test_after_the_last_port_comes_the_one_before(monkeypatch: pytest.MonkeyPatch) -> None:
    taken = Mock(side_effect=OSError(errno.EADDRINUSE, "Address already in use"))
    monkeypatch.setattr(zenoh_sessions, "check_free", taken)
    with pytest.raises(InputError, match=r"by --listen tcp/127\.0\.0\.1:65534\.$"):
        open_hub("tcp/127.0.0.1:65535")


def test_a_hub_that_is_not_there_is_told_after_the_patience(endpoint: str) -> None:
    with pytest.raises(InputError, match=f"^no hub answered at {endpoint} in .* begin with tls/"):
        connect(endpoint, 0.0)


def test_a_host_that_nobody_knows_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    unknown = Mock(side_effect=socket.gaierror(socket.EAI_NONAME, "Name or service not known"))
    monkeypatch.setattr("common.endpoint.socket.getaddrinfo", unknown)
    with pytest.raises(Unreachable, match=r"^this machine knows no host called nohost: name the"):
        connect("tcp/nohost:7447", 0.0)


def test_whoever_wants_to_stop_need_not_wait_for_a_hub(endpoint: str) -> None:
    with pytest.raises(KeyboardInterrupt):
        connect(endpoint, 1e9, lambda: True)


def test_a_hub_that_starts_later_is_waited_for(endpoint: str) -> None:
    hubs: list[ZenohTransport] = []

    def start_one() -> bool:
        if not hubs:  # the one that is there may be slow to answer
            hubs.append(open_hub(endpoint))
        return False

    client = connect(endpoint, PATIENCE, start_one)
    try:
        assert len(hubs) == 1
        assert [str(zid) for zid in client.session.info.routers_zid()] == [
            str(hubs[0].session.info.zid())
        ]
    finally:
        client.close()
        hubs[0].close()


def test_what_is_longer_than_anybody_sends_is_dropped_at_the_hub(
    zenoh_hub: ZenohTransport, zenoh_client: ZenohTransport
) -> None:
    """Else a queue of them takes the hub's memory before any is looked at."""
    keys, heard = RunKeys("r"), []
    zenoh_hub.subscribe(keys.stats("*", "*"), lambda told: heard.append(len(told.payload)))
    zenoh_hub.serve(keys.insert("*"), lambda request: b"%d" % len(request.payload))
    zenoh_hub.serve(keys.job("e"), lambda request: b"%d" % len(request.payload))
    stats = zenoh_client.publisher(keys.stats("actor", "a"))

    lengths = cycle((70_000, 60_000))  # one at a time: two at once would be too often

    def told() -> bool:
        stats.publish(b"x" * next(lengths))
        return len(heard) >= 3

    wait_until(told, "heartbeats are heard")
    assert set(heard) == {60_000}
    insert, job = (zenoh_client.requester(key, 1.0) for key in (keys.insert("a"), keys.job("e")))
    wait_until(lambda: insert.has_server and job.has_server, "both are served")
    chunk = insert.request(b"x" * 30 * 2**20)
    assert isinstance(job.request(b"x" * 70_000).exception(), Unanswered)
    assert isinstance(insert.request(b"x" * 33 * 2**20).exception(), Unanswered)
    assert chunk.exception() is not None or chunk.result().payload == b"%d" % (30 * 2**20)


def test_what_is_longer_than_anybody_sends_is_dropped_at_a_client(
    zenoh_hub: ZenohTransport, zenoh_client: ZenohTransport
) -> None:
    """Else a hub that was taken over takes the memory of all who joined it."""
    keys = RunKeys("r")
    served = zenoh_hub.serve(keys.latest_weights, lambda request: bytes(int(request.payload)))
    asking = zenoh_client.requester(keys.latest_weights, 30.0)
    wait_until(lambda: asking.has_server, "weights are served")
    longest = asking.request(b"%d" % MAX_MESSAGE_BYTES).result()
    assert len(longest.payload) == MAX_MESSAGE_BYTES
    too_long = asking.request(b"%d" % (MAX_MESSAGE_BYTES + 2**20))
    assert isinstance(too_long.exception(), Unanswered)
    served.close()


def test_who_asks_or_tells_too_often_is_not_heard(
    zenoh_hub: ZenohTransport, zenoh_client: ZenohTransport, endpoint: str
) -> None:
    """Each connection has its own measure, whatever names it uses."""
    keys = RunKeys("r")
    heard: list[Envelope] = []
    zenoh_hub.subscribe(keys.stats("*", "*"), heard.append)
    zenoh_hub.serve(keys.latest_weights, lambda _: b"weights")
    flood = [zenoh_client.publisher(keys.stats("actor", name)) for name in ("a", "b")]
    asking = zenoh_client.requester(keys.latest_weights, PATIENCE)
    wait_until(lambda: asking.has_server, "weights are served")
    began = time.monotonic()
    for turn in range(2_000):
        flood[turn % 2].publish(b"")
    answers = [asking.request(b"") for _ in range(100)]
    given = sum(answer.exception() is None for answer in answers)  # all have ended
    seconds = time.monotonic() - began
    assert 1 <= len(heard) <= 1 + 100 * seconds
    assert 1 <= given <= 1 + 5 * seconds
    with connect(endpoint, PATIENCE) as other:
        asking = other.requester(keys.latest_weights, PATIENCE)
        wait_until(lambda: asking.has_server, "weights are served to others")
        assert asking.request(b"").result().payload == b"weights"


def test_requests_that_nobody_gets_to_answer_hold_up_nothing_else(
    zenoh_hub: ZenohTransport, zenoh_client: ZenohTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As while a disk stalls. A full queue would block Zenoh's own threads, heartbeats and all."""
    monkeypatch.setattr(zenoh_entities, "_QUEUE", 3)
    keys, begun, goes_on = RunKeys("r"), threading.Event(), threading.Event()

    def answer(request: Request) -> bytes:
        begun.set()
        assert goes_on.wait(PATIENCE)
        return request.payload

    zenoh_hub.serve(keys.insert("a"), answer)
    zenoh_hub.serve(keys.progress, lambda _: b"at once")
    stalled = zenoh_client.requester(keys.insert("a"), PATIENCE)
    other = zenoh_client.requester(keys.progress, PATIENCE)
    wait_until(lambda: stalled.has_server and other.has_server, "both are served")
    try:
        answers = [stalled.request(b"0")]
        assert begun.wait(PATIENCE)
        answers += [stalled.request(b"%d" % number) for number in range(1, 9)]
        assert other.request(b"").result().payload == b"at once"
    finally:
        goes_on.set()
    told = [None if each.exception() else each.result().payload for each in answers]
    assert told == [b"0", None, None, None, None, None, b"6", b"7", b"8"]


def test_what_was_damaged_on_its_way_is_as_good_as_not_sent(
    zenoh_hub: ZenohTransport, zenoh_client: ZenohTransport, caplog: pytest.LogCaptureFixture
) -> None:
    raw, keys = zenoh_client.session, RunKeys("damaged")
    asked: list[bytes] = []
    heard: list[Envelope] = []
    key = keys.insert("a")

    def answer(request: Request) -> bytes:
        asked.append(request.payload)
        return b"done"

    zenoh_hub.serve(key, answer)
    zenoh_hub.subscribe(keys.weights, heard.append)
    good = zenoh_client.requester(key, PATIENCE)
    wait_until(lambda: good.has_server, "it is served")
    sealed = seal(key, b"payload")
    for spoiled in (None, b"", sealed[:3], seal(keys.sample, b"payload"), seal(key, b"q")):
        told = list(raw.get(key, payload=b"payload", attachment=spoiled, timeout=PATIENCE))
        assert told == []
        raw.put(keys.weights, b"weights", attachment=spoiled)
    assert good.request(b"whole").result().payload == b"done"
    assert asked == [b"whole"]
    publisher = zenoh_client.publisher(keys.weights)

    def are_heard() -> bool:
        publisher.publish(b"weights", b"7")
        return bool(heard)

    wait_until(are_heard, "whole weights are heard")
    assert set(heard) == {Envelope(b"weights", b"7", keys.weights)}
    assert sorted(told.split(": ")[0] for told in caplog.messages) == [  # once, not five times
        f"a request at {key} is not answered",
        f"what came at {keys.weights} is passed over",
    ]


def test_who_answers_without_end_is_not_listened_to_without_end(
    zenoh_hub: ZenohTransport,
    zenoh_client: ZenohTransport,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    def answer(query: zenoh.Query) -> None:
        for number in range(100):
            key = RunKeys(f"r{number}").config
            query.reply(key, bytes(1_000), attachment=seal(key, bytes(1_000)))

    monkeypatch.setattr(zenoh_transport, "LONGEST_RECEIVED", 10_000)
    everywhere, one = RunKeys("*").config, RunKeys("r").job("e")
    served: Any = zenoh_hub.session.declare_queryable(everywhere, answer)
    found = wait_until(lambda: zenoh_client.gather(everywhere, PATIENCE), "it answers")
    assert sum(len(each.payload) for each in found) == 11_000
    assert "no more than 10000 bytes of answers at ale-robot/*/config are taken" in caplog.text
    zenoh_hub.serve(one, lambda _: b"still")
    wait_until(lambda: zenoh_client.gather(one, PATIENCE), "others answer still")
    served.undeclare()


_RUN = RunKeys("r")


@pytest.mark.parametrize(
    ("key", "most"),
    [
        *((key, 2**16) for key in (_RUN.held_out, _RUN.report("e"))),
        (_RUN.sample, 2**22),
        (_RUN.insert("a"), 2**25),
    ],
)
def test_a_hub_drops_what_is_longer_than_anything_that_is_asked(
    zenoh_hub: ZenohTransport, zenoh_client: ZenohTransport, key: str, most: int
) -> None:
    sizes: list[int] = []

    def answer(request: Request) -> bytes:
        sizes.append(request.size)
        return b"ok"

    zenoh_hub.serve(key, answer)
    wait_until(lambda: zenoh_client.gather(key, 1.0), "it is served")
    zenoh_client.gather(key, 0.1, bytes(most + 1))
    wait_until(lambda: zenoh_client.gather(key, 1.0, bytes(most // 2)), "half of it is answered")
    assert max(sizes) == most // 2


def test_a_hub_drops_reports_that_are_longer_than_any(
    zenoh_hub: ZenohTransport, zenoh_client: ZenohTransport
) -> None:
    key, heard = _RUN.stats("actor", "a"), list[int]()
    zenoh_hub.subscribe(key, lambda told: heard.append(len(told.payload)))
    publisher, lengths = zenoh_client.publisher(key), cycle((2**16 + 1, 2**15, 2**15))

    def are_heard() -> bool:
        publisher.publish(bytes(next(lengths)))  # one at a time: two at once would be too often
        return len(heard) >= 4

    wait_until(are_heard, "the shorter ones are heard")
    assert set(heard) == {2**15}


@pytest.mark.parametrize(
    "answer",
    [
        lambda query: query.reply(query.key_expr, b"x"),
        lambda query: query.reply(query.key_expr, b"x", attachment=seal("other", b"x")),
        lambda query: query.reply_err(b"no"),
        lambda query: query.reply_err(seal("refusal", b"no") + b"n0"),
    ],
)
def test_a_damaged_answer_is_no_answer(
    zenoh_hub: ZenohTransport, zenoh_client: ZenohTransport, answer: Callable[[zenoh.Query], None]
) -> None:
    key = RunKeys("r").job("e")
    served: Any = zenoh_hub.session.declare_queryable(key, answer)
    requester = zenoh_client.requester(key, PATIENCE)
    wait_until(lambda: requester.has_server, "it is served")
    assert isinstance(requester.request(b"").exception(), Unanswered)
    assert zenoh_client.gather(key, PATIENCE) == []
    served.undeclare()


@pytest.mark.parametrize(
    ("host", "only_here"),
    [("127.0.0.1", True), ("127.8.8.8", True), ("::1", True), ("localhost", True),
     ("0.0.0.0", False), ("::", False), ("192.0.2.1", False), ("example.org", False)],
)  # fmt: skip
def test_who_reaches_an_address_is_known(host: str, only_here: bool) -> None:
    assert is_loopback(host) is only_here


def test_a_hub_that_is_open_to_others_says_so(
    caplog: pytest.LogCaptureFixture, endpoint: str
) -> None:
    with open_hub(endpoint):
        assert not caplog.messages
    everywhere = endpoint.replace("127.0.0.1", "0.0.0.0")
    with open_hub(everywhere):
        assert caplog.messages[0].startswith(f"whoever reaches {everywhere} can send chunks")
