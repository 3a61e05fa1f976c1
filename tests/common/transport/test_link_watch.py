"""A connection that brings no answers is ended, and made anew."""

import queue
import threading
from collections.abc import Iterator
from unittest.mock import Mock

import pytest
import zenoh

from benchmarks.child import free_endpoint
from common.transport import link_watch, zenoh_transport
from common.transport.chosen import connect, open_hub
from common.transport.interface import Request, Unanswered
from common.transport.link_watch import LinkWatch
from tests.patience import PATIENCE, wait_until


class Line:
    """A link's watch, which the test turns, and the seconds at which the link was ended."""

    def __init__(self) -> None:
        self.now = 100.0
        self.ended: list[float] = []
        self.there = True
        self.spread = 1.0
        self.watch = LinkWatch(self.renew, lambda: self.now, lambda: self.spread)

    def renew(self) -> bool:
        self.ended.append(self.now - 100.0)
        return self.there

    def passes(self, seconds: int, *unanswered: str, answered: str = "") -> None:
        """Lets seconds pass, in each of which keys are asked."""
        for _ in range(seconds):
            for key in unanswered:
                self.watch.unanswered(key)
            if answered:
                self.watch.answered(answered)
            self.now += 1.0
            self.watch.look()


@pytest.fixture
def line(monkeypatch: pytest.MonkeyPatch) -> Iterator[Line]:
    monkeypatch.setattr(link_watch, "_LOOK", 3_600.0)
    line = Line()
    yield line
    monkeypatch.undo()
    line.watch.close()


def test_each_next_wait_is_twice_as_long_up_to_ten_minutes(line: Line) -> None:
    line.passes(3_000, "insert/a")
    waits = [20, 40, 80, 160, 320, 600, 600, 600]
    assert line.ended == [sum(waits[: n + 1]) for n in range(8)]


def test_waits_are_spread(line: Line) -> None:
    line.spread = 1.4
    line.passes(90, "a")
    assert line.ended == [28, 28 + 56]
    for _ in range(100):
        assert 1.0 <= link_watch._spread() <= 1.5


def test_one_lost_request_of_who_asks_rarely_ends_nothing(line: Line) -> None:
    for _ in range(20):
        line.passes(1, "weights")
        line.passes(30, answered="insert")
    assert line.ended == []
    assert line.watch._silences == {}


def test_requests_that_time_out_after_five_seconds_are_a_silence(line: Line) -> None:
    for _ in range(5):
        line.passes(1, "a")
        line.passes(4)
    assert line.ended == [20]


def test_an_answer_at_the_same_key_ends_the_silence(line: Line) -> None:
    line.passes(19, "a")
    line.watch.answered("a")
    line.passes(19, "a", answered="b")  # the link may be deaf for one key only
    assert line.ended == []
    line.passes(1, "a")
    assert line.ended == [39]


def test_a_key_that_was_answered_once_has_its_first_patience_again(line: Line) -> None:
    line.passes(60, "a")
    line.watch.answered("a")
    line.passes(1_000)
    line.passes(20, "a")
    assert line.ended == [20, 60, 1_080]


def test_a_silence_begins_anew_after_a_pause(line: Line) -> None:
    line.passes(19, "a")
    line.now += 10.5  # while the watch itself was not turned
    line.passes(19, "a")
    assert line.ended == []
    line.passes(1, "a")
    assert line.ended == [49.5]


@pytest.mark.parametrize("there", [True, False])
def test_people_are_told_of_a_connection_that_was_ended(
    line: Line, there: bool, caplog: pytest.LogCaptureFixture
) -> None:
    line.there = there
    line.passes(21, "b", "a")
    told = "nothing was answered at a, b: this process connects anew, as its link may be deaf"
    assert caplog.messages == [told] * there
    assert len(line.ended) == 1


def test_a_silent_hub_is_connected_to_anew_and_then_answers(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(link_watch, "_LOOK", 0.02)
    monkeypatch.setattr(link_watch, "FIRST_PATIENCE", 0.3)
    endpoint = free_endpoint()
    presence: queue.Queue[bool] = queue.Queue()
    with open_hub(endpoint) as hub:
        deaf = threading.Event()
        deaf.set()

        def answer(request: Request) -> bytes | None:
            if deaf.is_set():
                request.drop()
                return None
            return b"yes"

        hub.serve("run/insert", answer)
        hub.watch_presence("run/alive/*", lambda key, present: presence.put(present))
        with connect(endpoint, PATIENCE) as client:
            client.announce("run/alive/a")
            assert presence.get(timeout=PATIENCE)
            requester = client.requester("run/insert", PATIENCE)
            wait_until(lambda: requester.has_server, "the hub's service is known")

            def is_answered() -> bool:
                try:
                    return requester.request(b"2").result(PATIENCE).payload == b"yes"
                except Unanswered:
                    if presence.qsize() >= 2:
                        deaf.clear()
                    return False

            wait_until(is_answered, "the new connection brings answers")
            gone = [presence.get(timeout=PATIENCE), presence.get(timeout=PATIENCE)]
            assert gone == [False, True]
            watch = client._watch
            assert watch is not None
            wait_until(lambda: not watch._silences, "the silence is over")
    assert "nothing was answered at run/insert: this process connects anew" in caplog.text


def test_a_server_that_is_not_known_counts_as_silent() -> None:
    """A client that knows none sends nothing, and a deaf link may be why it knows none."""
    endpoint = free_endpoint()
    with open_hub(endpoint), connect(endpoint, PATIENCE) as client:
        requester = client.requester("nobody", PATIENCE)
        assert not requester.has_server
        assert client._watch is not None
        assert set(client._watch._silences) == {"nobody"}


def test_a_hub_ends_no_connections_of_others() -> None:
    with open_hub(free_endpoint()) as hub:
        assert hub._watch is None


@pytest.mark.parametrize("error", [OSError(24, "Too many open files"), zenoh.ZError("closed")])
def test_a_connection_that_cannot_be_ended_ends_no_process(
    monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    endpoint = free_endpoint()
    with open_hub(endpoint), connect(endpoint, PATIENCE) as client:
        monkeypatch.setattr(zenoh_transport, "end_connections", Mock(side_effect=error))
        assert not client._end_links()


def test_a_requester_that_is_closed_waits_for_no_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    endpoint = free_endpoint()
    with open_hub(endpoint), connect(endpoint, PATIENCE) as client:
        requester = client.requester("nobody", 0.1)
        with pytest.raises(Unanswered):
            requester.request(b"").result(PATIENCE)
        assert client._watch is not None
        assert set(client._watch._silences) == {"nobody"}
        requester.close()
        assert client._watch._silences == {}
