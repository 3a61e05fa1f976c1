"""What every transport does, by Zenoh and within a process."""

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Protocol

import pytest

from benchmarks.child import free_endpoint
from common.errors import InputError, MessageError
from common.process.threads import end_with_any_thread
from common.transport.interface import Envelope, Request, Transport, Unanswered
from common.transport.requests import Window
from common.transport.zenoh_sessions import connect, open_hub
from tests.in_process_transport import InProcessHub
from tests.patience import PATIENCE, wait_until

KEY = "ale-robot/r/sample"


class Place(Protocol):
    """A hub that can be started anew, and its clients."""

    hub: Transport

    def join(self) -> Transport: ...

    def start_anew(self) -> None:
        """The hub's process dies, and another takes its place."""

    def close(self) -> None: ...


class ZenohPlace:
    def __init__(self) -> None:
        self._endpoint = free_endpoint()
        self.hub: Transport = open_hub(self._endpoint)
        self._clients: list[Transport] = []

    def join(self) -> Transport:
        self._clients.append(connect(self._endpoint, PATIENCE))
        return self._clients[-1]

    def start_anew(self) -> None:
        self.hub.close()
        self.hub = open_hub(self._endpoint)

    def close(self) -> None:
        for transport in (*self._clients, self.hub):
            transport.close()


class InProcessPlace:
    def __init__(self) -> None:
        self._meeting = InProcessHub()
        self.hub: Transport = self._meeting.connect()
        self._clients: list[Transport] = []

    def join(self) -> Transport:
        self._clients.append(self._meeting.connect())
        return self._clients[-1]

    def start_anew(self) -> None:
        self.hub.close()
        self.hub = self._meeting.connect()

    def close(self) -> None:
        for transport in (*self._clients, self.hub):
            transport.close()


@pytest.fixture(params=[ZenohPlace, InProcessPlace], ids=["zenoh", "in_process"])
def place(request: pytest.FixtureRequest) -> Iterator[Place]:
    place: Place = request.param()
    yield place
    place.close()


@pytest.fixture
def client(place: Place) -> Transport:
    return place.join()


class Server:
    """Serves a key; the test answers, request by request."""

    def __init__(self, transport: Transport, key: str = KEY) -> None:
        self._requests: SimpleQueue[Request] = SimpleQueue()
        self._service = transport.serve(key, self._requests.put)

    def next(self) -> Request:
        return self._requests.get(timeout=PATIENCE)

    def next_of(self, payload: bytes) -> Request:
        """The next request with ``payload``; others are dropped."""
        while (request := self.next()).payload != payload:
            request.drop()
        return request

    def close(self) -> None:
        self._service.close()


def echo(request: Request) -> bytes:
    return request.payload


def outcome(future: Future[Envelope]) -> bytes | str | None:
    """Payload of the answer, or reason of the refusal; None where nobody answered."""
    try:
        return future.result(PATIENCE).payload
    except MessageError as error:
        return str(error)
    except Unanswered:
        return None


def ask(transport: Transport, key: str, payload: bytes) -> bytes | str | None:
    """The outcome once a server at ``key`` is known."""
    requester = transport.requester(key, PATIENCE)
    wait_until(lambda: requester.has_server, "a server is known")
    return outcome(requester.request(payload))


# ---------------------------------------------------------------------- requests


def test_a_request_is_answered(place: Place, client: Transport) -> None:
    key = "ale-robot/r/insert/a"  # where large requests are let in
    place.hub.serve(key, lambda request: request.key.encode() + b": " + request.payload)
    for payload in (b"who?", b"", bytes(range(256)) * 40_000):
        assert ask(client, key, payload) == key.encode() + b": " + payload


def test_an_answer_has_an_attachment_and_the_servers_key(place: Place, client: Transport) -> None:
    place.hub.serve(KEY, lambda _: Envelope(b"weights", b"12"))
    place.hub.serve("ale-robot/r/insert/*", echo)
    assert ask(client, KEY, b"") == b"weights"
    answer = client.requester("ale-robot/*/sample", PATIENCE).request(b"").result(PATIENCE)
    assert answer == Envelope(b"weights", b"12", KEY)
    assert ask(client, "ale-robot/r/insert/a", b"chunk") == b"chunk"
    requester = client.requester("ale-robot/r/insert/a", PATIENCE)
    answer = requester.request(b"chunk").result(PATIENCE)
    assert answer == Envelope(b"chunk", b"", "ale-robot/r/insert/a")


def test_a_server_reaches_its_own_transports_requesters(place: Place, client: Transport) -> None:
    for transport in (place.hub, client):
        key = f"{KEY}/{transport is client}"
        transport.serve(key, echo)
        assert ask(transport, key, b"me") == b"me"


def test_a_client_serves_as_the_hub_does(place: Place, client: Transport) -> None:
    client.serve(KEY, echo)
    assert ask(place.hub, KEY, b"from the hub") == b"from the hub"
    assert ask(place.join(), KEY, b"from another client") == b"from another client"


def test_a_refusal_tells_its_reason(place: Place, client: Transport) -> None:
    def refuse(request: Request) -> bytes:
        raise MessageError(f"{request.payload.decode()} has no é")

    place.hub.serve(KEY, refuse)
    assert ask(client, KEY, b"junk") == "junk has no é"


def test_a_server_that_fails_leaves_its_request_unanswered_and_goes_on(
    place: Place, client: Transport, caplog: pytest.LogCaptureFixture
) -> None:
    def answer(request: Request) -> bytes:
        return b"%d" % (1 // int(request.payload))

    place.hub.serve(KEY, answer)
    assert ask(client, KEY, b"0") is None
    assert ask(client, KEY, b"1") == b"1"
    assert "ZeroDivisionError" in caplog.text
    assert KEY in caplog.text


def test_where_there_is_no_server_a_request_ends_at_once(place: Place, client: Transport) -> None:
    requester = client.requester(KEY, 10 * PATIENCE)
    assert not requester.has_server
    assert outcome(requester.request(b"hello?")) is None
    server = Server(place.hub)
    wait_until(lambda: requester.has_server, "the server is known")
    server.close()
    wait_until(lambda: not requester.has_server, "the server is known to be gone")
    assert outcome(requester.request(b"hello?")) is None


def test_a_request_that_is_dropped_ends_unanswered(place: Place, client: Transport) -> None:
    server = Server(place.hub)
    requester = client.requester(KEY, 10 * PATIENCE)
    wait_until(lambda: requester.has_server, "the server is known")
    future = requester.request(b"?")
    server.next().drop()
    assert outcome(future) is None


def test_a_request_ends_by_its_deadline(place: Place, client: Transport) -> None:
    server = Server(place.hub)
    requester = client.requester(KEY, 0.1)
    wait_until(lambda: requester.has_server, "the server is known")
    future = requester.request(b"?")
    slow = server.next()
    assert outcome(future) is None
    slow.reply(b"too late")
    assert outcome(future) is None


def test_requests_under_way_are_served_in_order_and_answered_in_any(
    place: Place, client: Transport
) -> None:
    server = Server(place.hub)
    requester = client.requester(KEY, PATIENCE)
    wait_until(lambda: requester.has_server, "the server is known")
    futures = [requester.request(b"%d" % number) for number in range(20)]
    requests = [server.next() for _ in futures]
    assert [request.payload for request in requests] == [b"%d" % number for number in range(20)]
    for request in requests[::-1]:
        if request.payload == b"3":
            request.refuse("no threes")
        else:
            request.reply(request.payload + b"!")
    found = [outcome(future) for future in futures]
    assert found == ["no threes" if number == 3 else b"%d!" % number for number in range(20)]


def test_many_threads_ask_at_once(place: Place, client: Transport) -> None:
    place.hub.serve(KEY, echo)
    place.hub.serve(f"{KEY}/slow", echo)
    assert ask(client, KEY, b"") == b""
    requesters = [client.requester(KEY, PATIENCE), place.hub.requester(KEY, PATIENCE)]
    found: list[bool] = []

    def work(name: int) -> None:
        for number in range(50):
            payload = b"%d of %d" % (number, name)
            found.append(outcome(requesters[name % 2].request(payload)) == payload)

    threads = [threading.Thread(target=work, args=(name,)) for name in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE)
    assert found == [True] * 300


def test_a_slow_service_holds_up_no_other(place: Place, client: Transport) -> None:
    go_on = threading.Event()

    def slow(_: Request) -> bytes:
        go_on.wait(PATIENCE)
        return b"slow"

    place.hub.serve(KEY, slow)
    place.hub.serve(f"{KEY}/quick", echo)
    requester = client.requester(KEY, PATIENCE)
    wait_until(lambda: requester.has_server, "the server is known")
    future = requester.request(b"?")
    assert ask(client, f"{KEY}/quick", b"quick") == b"quick"
    assert not future.done()
    go_on.set()
    assert outcome(future) == b"slow"


def test_all_servers_of_a_pattern_are_heard_and_their_refusals_left_out(
    place: Place, client: Transport
) -> None:
    def refuse(_: Request) -> bytes:
        raise MessageError("not me")

    other = place.join()
    place.hub.serve("ale-robot/one/config", lambda _: b"one")
    other.serve("ale-robot/two/config", lambda _: Envelope(b"two", b"2"))
    place.hub.serve("ale-robot/three/config", refuse)
    place.hub.serve("ale-robot/one/job", lambda _: b"no")

    def found() -> set[Envelope]:
        answers = client.gather("ale-robot/*/config", PATIENCE)
        return set(answers) if len(answers) == 2 else set()

    assert wait_until(found, "both are known") == {
        Envelope(b"one", b"", "ale-robot/one/config"),
        Envelope(b"two", b"2", "ale-robot/two/config"),
    }
    assert client.gather("ale-robot/*/nothing", PATIENCE) == []


def test_gathering_ends_by_its_deadline(place: Place, client: Transport) -> None:
    server = Server(place.hub, "ale-robot/one/config")
    place.hub.serve("ale-robot/two/config", lambda _: b"two")
    wait_until(
        lambda: [m.payload for m in client.gather("ale-robot/*/config", 0.1)] == [b"two"],
        "the one that answers is heard",
    )
    server.close()


# ---------------------------------------------------------------------- coming and going


def test_a_server_that_went_away_is_found_again(place: Place, client: Transport) -> None:
    requester = client.requester(KEY, PATIENCE)
    for life in range(3):
        place.hub.serve(KEY, lambda request, life=life: b"%d" % life)  # type: ignore[misc]
        wait_until(lambda: requester.has_server, "the server is known")
        assert outcome(requester.request(b"?")) == b"%d" % life
        place.start_anew()


def test_what_is_under_way_to_a_server_that_dies_ends_unanswered(
    place: Place, client: Transport
) -> None:
    server = Server(place.hub)
    requester = client.requester(KEY, 20.0)
    wait_until(lambda: requester.has_server, "the server is known")
    future = requester.request(b"?")
    request = server.next()
    request.drop()
    place.start_anew()
    assert outcome(future) is None


def test_a_service_that_closes_drops_what_waits_there(place: Place, client: Transport) -> None:
    go_on, answering = threading.Event(), threading.Event()

    def answer(request: Request) -> bytes:
        answering.set()
        go_on.wait(PATIENCE)
        return request.payload

    service = place.hub.serve(KEY, answer)
    # Of a request that comes just as its server closes, Zenoh may tell at the deadline only.
    requester = client.requester(KEY, 10.0)
    wait_until(lambda: requester.has_server, "the server is known")
    futures = [requester.request(b"%d" % number) for number in range(3)]
    assert answering.wait(PATIENCE)
    closing = threading.Thread(target=service.close)
    closing.start()
    wait_until(lambda: not requester.has_server, "the server is known to be gone")
    assert closing.is_alive(), "it waits for the request that is being answered"
    go_on.set()
    closing.join(PATIENCE)
    assert [outcome(future) for future in futures[1:]] == [None, None]
    service.close()


def test_whoever_waits_is_let_go_by_closing(place: Place, client: Transport) -> None:
    server = Server(place.hub)
    requester = client.requester(KEY, 10 * PATIENCE)
    wait_until(lambda: requester.has_server, "the server is known")
    found: list[object] = []
    waiting = threading.Thread(target=lambda: found.append(outcome(requester.request(b"?"))))
    waiting.start()
    server.next()
    requester.close()
    waiting.join(PATIENCE)
    assert found == [None]
    assert outcome(requester.request(b"?")) is None
    requester.close()


def test_closing_a_transport_closes_all_that_is_its_own(place: Place) -> None:
    before = set(threading.enumerate())
    transport = place.join()
    transport.serve(KEY, echo)
    server = Server(place.hub, f"{KEY}/other")
    requester = transport.requester(f"{KEY}/other", 10 * PATIENCE)
    wait_until(lambda: requester.has_server, "the server is known")
    future = requester.request(b"?")
    held = server.next()
    transport.announce("ale-robot/r/live/actor/a")
    watched: list[tuple[str, bool]] = []
    place.hub.watch_presence("ale-robot/r/live/**", lambda *news: watched.append(news))
    wait_until(lambda: len(watched) == 1, "it is present")
    asking = place.hub.requester(KEY, PATIENCE)
    wait_until(lambda: asking.has_server, "the server is known")
    server.close()
    transport.close()
    assert outcome(future) is None
    held.drop()
    wait_until(lambda: watched[-1] == ("ale-robot/r/live/actor/a", False), "it is gone")
    wait_until(lambda: not asking.has_server, "its server is gone")
    assert not any(thread.is_alive() for thread in set(threading.enumerate()) - before)
    place.hub.serve(f"{KEY}/other", echo)
    assert outcome(requester.request(b"after the end")) is None
    transport.close()


# ---------------------------------------------------------------------- a window


class Lossless:
    """A window, and what was settled in it."""

    def __init__(self, transport: Transport) -> None:
        self.settled: list[bytes | str] = []
        self.requester = transport.requester(KEY, PATIENCE)
        self.window = Window(self.requester, self._settle)

    def _settle(self, outcome: Envelope | MessageError) -> None:
        self.settled.append(outcome.payload if isinstance(outcome, Envelope) else str(outcome))

    def wait(self, most: int = 0) -> None:
        wait_until(lambda: self.window.wait(most, 0.05), f"{most} are unsettled")


def test_a_window_waits_for_room(place: Place, client: Transport) -> None:
    server, sender = Server(place.hub), Lossless(client)
    wait_until(lambda: sender.requester.has_server, "the server is known")
    for number in range(3):
        sender.window.send(b"%d" % number)
    requests = [server.next() for _ in range(3)]
    assert not sender.window.wait(2, 0.05)
    assert len(sender.window) == 3
    requests[1].reply(b"one")
    sender.wait(2)
    assert (sender.settled, len(sender.window)) == ([b"one"], 2)
    requests[0].refuse("zero")
    requests[2].reply(b"two")
    sender.wait()
    assert sorted(map(str, sender.settled[1:])) == ["b'two'", "zero"]
    assert sender.window.sent_again == 0


def test_what_a_window_holds_survives_a_server(place: Place, client: Transport) -> None:
    sender = Lossless(client)
    sender.window.send(b"before there is one")
    assert not sender.window.wait(0, 0.05)
    assert sender.window.sent_again == 0, "sent again to nobody"
    server = Server(place.hub)
    working = threading.Thread(target=sender.wait)
    working.start()
    server.next().drop()
    server.next()  # the server dies with it
    place.start_anew()
    server = Server(place.hub)
    server.next().reply(b"stored")
    working.join(PATIENCE)
    assert sender.settled == [b"stored"]
    # After the answer that was dropped and after the death; on a slow machine the first request
    # may still be looking for a server when there is one.
    assert sender.window.sent_again >= 2


# ---------------------------------------------------------------------- telling and presence


class Heard:
    """What was heard at a key, in order."""

    def __init__(self, transport: Transport, key: str) -> None:
        self.messages: list[Envelope] = []
        self.subscription = transport.subscribe(key, self.messages.append)

    def is_reached_by(self, tell: Callable[[], None]) -> None:
        """Until a publication is heard nobody knows of a new subscription."""

        def heard() -> bool:
            tell()
            return bool(self.messages)

        wait_until(heard, "something is heard")


def test_what_is_published_is_heard_in_order_with_its_attachment(
    place: Place, client: Transport
) -> None:
    heard = [Heard(client, "ale-robot/r/*"), Heard(place.hub, "ale-robot/r/weights")]
    unheard = Heard(client, "ale-robot/s/**")
    for transport in (place.hub, client):
        publisher = transport.publisher("ale-robot/r/weights")
        for listener in heard:
            listener.messages.clear()
            listener.is_reached_by(lambda publisher=publisher: publisher.publish(b"mark"))  # type: ignore[misc]
        publisher.publish(b"3", b"three")
        publisher.publish(b"4")
        for listener in heard:
            wait_until(lambda listener=listener: listener.messages[-1].payload == b"4", "both")  # type: ignore[misc]
            assert listener.messages[-2:] == [
                Envelope(b"3", b"three", "ale-robot/r/weights"),
                Envelope(b"4", b"", "ale-robot/r/weights"),
            ]
        publisher.close()
    assert unheard.messages == []


def test_a_subscription_that_is_closed_hears_nothing(place: Place, client: Transport) -> None:
    closed, open_ = Heard(client, KEY), Heard(client, KEY)
    publisher = place.hub.publisher(KEY)
    open_.is_reached_by(lambda: publisher.publish(b"mark"))
    publisher.publish(b"last")
    wait_until(lambda: closed.messages[-1].payload == b"last", "all is heard")
    closed.subscription.close()
    closed.messages.clear()
    open_.messages.clear()
    open_.is_reached_by(lambda: publisher.publish(b"more"))
    assert closed.messages == []
    closed.subscription.close()


def test_presence_is_seen_from_its_beginning_to_its_end(place: Place, client: Transport) -> None:
    first = client.announce("ale-robot/r/live/actor/a")
    seen: SimpleQueue[tuple[str, bool]] = SimpleQueue()
    place.hub.watch_presence("ale-robot/r/live/**", lambda *news: seen.put(news))
    assert seen.get(timeout=PATIENCE) == ("ale-robot/r/live/actor/a", True)
    watched: SimpleQueue[tuple[str, bool]] = SimpleQueue()  # by one who comes later
    watch = place.hub.watch_presence("ale-robot/r/live/*/*", lambda *news: watched.put(news))
    assert watched.get(timeout=PATIENCE) == ("ale-robot/r/live/actor/a", True)
    other = place.join()
    other.announce("ale-robot/s/live/actor/a")
    other.announce("ale-robot/r/live/evaluator/e")
    assert watched.get(timeout=PATIENCE) == ("ale-robot/r/live/evaluator/e", True)
    first.close()
    assert watched.get(timeout=PATIENCE) == ("ale-robot/r/live/actor/a", False)
    other.close()
    assert watched.get(timeout=PATIENCE) == ("ale-robot/r/live/evaluator/e", False)
    first.close()
    watch.close()
    client.announce("ale-robot/r/live/actor/b")
    assert watched.empty()


# ---------------------------------------------------------------------- callbacks that fail


@pytest.mark.parametrize("verb", ["subscribe", "watch_presence", "window"])
def test_a_callback_that_fails_ends_the_process_with_its_reason(
    place: Place, client: Transport, verb: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(threading, "excepthook", lambda _: None)
    stop = threading.Event()

    def fail(*_: object) -> None:
        if not stop.is_set():
            raise ValueError("a version of twenty nines")

    def live() -> None:
        with end_with_any_thread(stop):
            if verb == "subscribe":
                place.hub.subscribe(KEY, fail)
                publisher = client.publisher(KEY)

                def is_heard() -> bool:
                    publisher.publish(b"?")
                    return stop.is_set()

                wait_until(is_heard, "it is heard")
            elif verb == "watch_presence":
                place.hub.watch_presence(KEY, fail)
                client.announce(KEY)
            else:
                place.hub.serve(KEY, echo)
                requester = client.requester(KEY, PATIENCE)
                wait_until(lambda: requester.has_server, "the server is known")
                Window(requester, fail).send(b"?")
            assert stop.wait(PATIENCE)

    with pytest.raises(InputError, match=r"died \(ValueError: a version of twenty nines\)"):
        live()
