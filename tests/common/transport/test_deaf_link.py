"""A connection that brings no answers is ended, and made anew."""

import queue
from collections.abc import Iterator

import pytest

from benchmarks.child import free_endpoint
from common.transport import deaf_link
from common.transport.chosen import connect, open_hub
from common.transport.deaf_link import DeafLink
from common.transport.interface import Request, Unanswered
from tests.patience import PATIENCE, wait_until


class Line:
    """A link's watch, which the test turns, and the times at which the link was ended."""

    def __init__(self) -> None:
        self.now = 100.0
        self.ended: list[float] = []
        self.there = True
        self.watch = DeafLink(self.renew, lambda: self.now)

    def renew(self) -> bool:
        self.ended.append(self.now - 100.0)
        return self.there

    def passes(self, seconds: int) -> None:
        for _ in range(seconds):
            self.now += 1.0
            self.watch.look()


@pytest.fixture
def line(monkeypatch: pytest.MonkeyPatch) -> Iterator[Line]:
    monkeypatch.setattr(deaf_link, "_LOOK", 3_600.0)
    line = Line()
    yield line
    monkeypatch.undo()
    line.watch.close()


def test_each_further_attempt_waits_twice_as_long_up_to_ten_minutes(line: Line) -> None:
    line.watch.miss("insert/a")
    for _ in range(3_000):
        line.passes(1)
        line.watch.miss("insert/a")
    waits = [20, 40, 80, 160, 320, 600, 600, 600]
    assert line.ended == [sum(waits[: n + 1]) for n in range(8)]


def test_an_answer_at_the_same_key_ends_the_silence(line: Line) -> None:
    line.watch.miss("a")
    line.passes(19)
    line.watch.hear("a")
    line.watch.miss("a")
    line.passes(19)
    line.watch.hear("b")  # the link may be deaf for one key only
    assert line.ended == []
    line.passes(1)
    assert line.ended == [39]


def test_a_key_that_was_answered_once_is_patient_again_only_for_as_long_as_at_first(
    line: Line,
) -> None:
    line.watch.miss("a")
    line.passes(60)
    line.watch.hear("a")
    line.passes(1_000)
    line.watch.miss("a")
    line.passes(20)
    assert line.ended == [20, 60, 1_080]


@pytest.mark.parametrize("there", [True, False])
def test_people_are_told_of_a_connection_that_was_ended(
    line: Line, there: bool, caplog: pytest.LogCaptureFixture
) -> None:
    line.there = there
    for key in ("b", "a"):
        line.watch.miss(key)
    line.passes(21)
    told = "nothing was answered at a, b, so this process has ended its connection to the hub"
    assert caplog.messages == [told] * there
    assert len(line.ended) == 1


def test_a_silent_hub_is_connected_to_anew_and_then_answers(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(deaf_link, "_LOOK", 0.02)
    monkeypatch.setattr(deaf_link, "_FIRST_PATIENCE", 0.3)
    endpoint = free_endpoint()
    presence: queue.Queue[bool] = queue.Queue()
    with open_hub(endpoint) as hub:
        drops = iter([True])

        def answer(request: Request) -> bytes | None:
            if next(drops, False):
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
            with pytest.raises(Unanswered):
                requester.request(b"1").result(PATIENCE)
            assert not presence.get(timeout=PATIENCE), "the connection ends"
            assert presence.get(timeout=PATIENCE), "and is made anew"

            def is_answered() -> bool:
                try:
                    return requester.request(b"2").result(PATIENCE).payload == b"yes"
                except Unanswered:
                    return False

            wait_until(is_answered, "the new connection brings answers")
            deaf = client._deaf
            assert deaf is not None
            wait_until(lambda: not deaf._silences, "the silence is over")
    ended = "nothing was answered at run/insert, so this process has ended"
    assert caplog.messages[0].startswith(ended)


def test_a_requester_that_is_closed_waits_for_no_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    endpoint = free_endpoint()
    with open_hub(endpoint), connect(endpoint, PATIENCE) as client:
        requester = client.requester("nobody", 0.1)
        with pytest.raises(Unanswered):
            requester.request(b"").result(PATIENCE)
        assert client._deaf is not None
        assert set(client._deaf._silences) == {"nobody"}
        requester.close()
        assert client._deaf._silences == {}
