"""The insert client: nothing is lost, whatever the other side does."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest

from actors.absence import Absence
from actors.member import Member
from actors.stream import insert_client
from actors.stream.insert_client import InsertClient
from common.errors import InputError
from common.protocol.ack import Ack
from common.protocol.run_keys import RunKeys
from common.settings.config import StreamConfig
from common.settings.presets import PRESETS
from common.transport.interface import Request, Transport
from tests.hub_stubs import STORED, PendingRequests, acknowledge
from tests.in_process_transport import InProcessHub
from tests.patience import PATIENCE, wait_until

KEY = RunKeys("r").insert("a")
WINDOW = 2
CONFIG = replace(PRESETS["fast"], stream=StreamConfig(window=WINDOW))


@pytest.fixture
def replay(hub: Transport) -> Iterator[PendingRequests]:
    questions = PendingRequests(hub, RunKeys("r").insert("*"))
    yield questions
    questions.close()


class Sender:
    """An insert client, what it warned of, and a way to let it wait in a thread of its own."""

    def __init__(self, client: Transport, patience: float = 300.0) -> None:
        self.stop = threading.Event()
        self.warnings: list[str] = []
        self.client = InsertClient(
            Member(
                *("a", client, RunKeys("r"), CONFIG, patience, self.stop, 1, self.warnings.append)
            ),
            self._paused,
        )
        self.pauses: list[str] = []

    @contextmanager
    def _paused(self) -> Iterator[None]:
        self.pauses.append("begin")
        yield
        self.pauses.append("end")

    def beside(self, work: Callable[[], object]) -> threading.Thread:
        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        return thread

    def counts(self) -> tuple[int, int, int, int]:
        """Made, acknowledged, retried, refused."""
        return self.client.made, self.client.acked, self.client.retried, self.client.refused

    def settled(self) -> None:
        wait_until(lambda: self.client.unacknowledged == 0, "all is acknowledged")


@pytest.fixture
def sender(
    replay: PendingRequests, client: Transport, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Sender]:
    monkeypatch.setattr(insert_client, "ACK_TIMEOUT", PATIENCE)  # whatever holds the test up
    sender = Sender(client)
    yield sender
    sender.stop.set()


def joined(thread: threading.Thread) -> None:
    thread.join(PATIENCE)
    assert not thread.is_alive()


def test_chunks_arrive_and_their_acks_count(replay: PendingRequests, sender: Sender) -> None:
    for number in range(5):
        sender.client.post(b"chunk %d" % number)
        query = replay.next()
        assert query.key == KEY
        assert query.payload == b"chunk %d" % number
        ack = replace(STORED, agent_steps=64 * number, weights_version=number)
        acknowledge(query, ack)
        sender.settled()
        assert sender.client.last_ack == ack
    assert sender.counts() == (5, 5, 0, 0)
    assert sender.warnings == []


def test_send_returns_while_there_is_room_and_waits_at_the_window(
    replay: PendingRequests, sender: Sender
) -> None:
    sender.client.send(b"first")  # returns: one more may be under way
    assert sender.pauses == []
    waiting = sender.beside(lambda: sender.client.send(b"second"))
    first, second = replay.next(), replay.next()
    assert [first.payload, second.payload] == [b"first", b"second"]
    waiting.join(0.3)
    assert waiting.is_alive()
    assert sender.client.unacknowledged == WINDOW
    assert sender.pauses == ["begin"]
    acknowledge(second)
    joined(waiting)
    assert sender.pauses == ["begin", "end"]
    assert sender.client.unacknowledged == 1
    acknowledge(first)
    sender.settled()
    assert sender.counts() == (2, 2, 0, 0)


def test_never_more_than_the_window_is_under_way(replay: PendingRequests, sender: Sender) -> None:
    sent = [b"%d" % number for number in range(20)]

    def send_all() -> None:
        for payload in sent:
            sender.client.send(payload)

    working = sender.beside(send_all)
    arrived: list[bytes] = []
    open_queries: list[Request] = []
    while len(arrived) < len(sent):
        open_queries.append(replay.next())
        arrived.append(open_queries[-1].payload)
        # The last answer may have let the next one go already, but never two.
        open_queries += (found := list(replay.waiting()))
        arrived += (each.payload for each in found)
        assert len(open_queries) <= WINDOW
        if len(open_queries) == WINDOW or len(arrived) == len(sent):
            acknowledge(open_queries.pop(0))
    for query in open_queries:
        acknowledge(query)
    joined(working)
    sender.settled()
    assert arrived == sent
    assert sender.counts() == (20, 20, 0, 0)


def test_a_wish_to_stop_ends_the_wait(replay: PendingRequests, sender: Sender) -> None:
    sender.client.send(b"first")
    waiting = sender.beside(lambda: sender.client.send(b"second"))
    first, second = replay.next(), replay.next()
    sender.stop.set()
    joined(waiting)
    assert sender.client.unacknowledged == 2
    for query in (first, second):
        query.drop()


def test_a_query_that_ended_without_an_answer_is_sent_again(
    replay: PendingRequests, sender: Sender
) -> None:
    sender.client.post(b"chunk")
    flushing = sender.beside(lambda: sender.client.flush(PATIENCE))
    for _ in range(2):
        query = replay.next()
        assert query.payload == b"chunk"
        query.drop()
    acknowledge(replay.next())
    joined(flushing)
    assert sender.counts() == (1, 1, 2, 0)


def test_an_insert_without_an_answer_is_sent_again_after_its_time(
    replay: PendingRequests, client: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(insert_client, "ACK_TIMEOUT", 0.3)
    sender = Sender(client)
    sender.client.post(b"chunk")
    too_late = replay.next()
    flushing = sender.beside(lambda: sender.client.flush(PATIENCE))
    again = replay.next()  # comes only if it was sent again
    assert too_late.payload == again.payload == b"chunk"
    acknowledge(too_late)  # nobody listens any more
    acknowledge(again)

    def done() -> bool:
        for query in replay.waiting():  # where this thread was too slow for ``again``, too
            acknowledge(query)
        return not flushing.is_alive()

    wait_until(done, "it is acknowledged")
    made, acked, retried, refused = sender.counts()
    assert (made, acked, refused) == (1, 1, 0)
    assert retried >= 1
    assert sender.warnings == []


def test_a_refusal_is_told_and_final(replay: PendingRequests, sender: Sender) -> None:
    sender.client.post(b"bad chunk")
    replay.next().refuse("frames has shape [1] where … is expected")
    sender.settled()
    sender.client.post(b"good chunk")
    query = replay.next()
    assert query.payload == b"good chunk"
    acknowledge(query)
    sender.settled()
    assert sender.counts() == (2, 1, 0, 1)
    assert sender.warnings == [
        "a: the replay refused a chunk: frames has shape [1] where … is expected"
    ]


def test_a_malformed_reply_counts_as_a_refusal(replay: PendingRequests, sender: Sender) -> None:
    sender.client.post(b"chunk")
    replay.next().reply(b"garbage")
    sender.settled()
    wait_until(lambda: sender.warnings, "it is told")
    assert sender.counts() == (1, 0, 0, 1)
    assert "a malformed reply" in sender.warnings[0]
    assert sender.client.last_ack is None


def test_flush_gives_up_after_its_time(replay: PendingRequests, sender: Sender) -> None:
    sender.client.post(b"chunk")
    query = replay.next()
    sender.client.flush(0.05)
    assert sender.client.unacknowledged == 1
    query.drop()


def test_flush_waits_for_a_hub_that_is_slow(
    replay: PendingRequests, sender: Sender, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(insert_client, "_AWAY", 0.05)
    sender.client.post(b"chunk")
    flushing = sender.beside(lambda: sender.client.flush(PATIENCE))
    query = replay.next()
    flushing.join(0.3)
    assert flushing.is_alive()
    acknowledge(query)
    joined(flushing)
    assert sender.counts() == (1, 1, 0, 0)


def test_flush_does_not_wait_for_a_hub_that_is_away(
    client: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(insert_client, "_AWAY", 0.05)
    sender = Sender(client)
    sender.client.post(b"chunk")
    sender.client.flush(math.inf)
    assert sender.client.unacknowledged == 1


def test_a_poll_is_answered_by_what_to_do(replay: PendingRequests, sender: Sender) -> None:
    found: list[object] = []
    polling = sender.beside(lambda: found.append(sender.client.poll()))
    query = replay.next()
    assert query.payload == b""
    ack = replace(STORED, status="poll", throttle=True, agent_steps=5)
    acknowledge(query, ack)
    joined(polling)
    assert found == [ack]
    assert sender.client.last_ack == ack
    assert sender.counts() == (0, 0, 0, 0)


def test_a_poll_that_nobody_hears_is_no_answer(
    client: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    sender = Sender(client)
    pauses: list[float] = []
    monkeypatch.setattr(sender.stop, "wait", pauses.append)
    assert sender.client.poll() is None
    assert pauses == [0.2]  # or an actor without a hub would keep a core busy
    assert sender.client.last_ack is None


def test_a_hub_that_starts_anew_in_the_middle_gets_everything(
    meeting: InProcessHub, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(insert_client, "_AWAY", PATIENCE)
    hub = meeting.connect()
    before = PendingRequests(hub, KEY)
    client = meeting.connect()
    sender = Sender(client)
    try:
        sender.client.send(b"0")
        acknowledge(before.next())
        sender.settled()
        sender.client.send(b"1")
        before.next()

        def send_the_rest() -> None:
            for number in range(2, 6):
                sender.client.send(b"%d" % number)
            sender.client.flush(PATIENCE)

        working = sender.beside(send_the_rest)
        before.next()
        hub.close()
        hub = meeting.connect()
        after = PendingRequests(hub, KEY)
        stored: set[bytes] = set()

        def done() -> bool:
            for query in after.waiting():  # an answer that came too late is asked for again
                stored.add(query.payload)
                acknowledge(query)
            return not working.is_alive()

        wait_until(done, "all is acknowledged")
        assert stored == {b"1", b"2", b"3", b"4", b"5"}
        made, acked, retried, refused = sender.counts()
        assert (made, acked, refused) == (6, 6, 0)
        assert retried >= 2
    finally:
        sender.stop.set()
        client.close()
        hub.close()


@pytest.mark.parametrize("way", ["send", "poll"])
def test_patience_with_a_hub_that_went_away_ends(meeting: InProcessHub, way: str) -> None:
    hub = meeting.connect()
    replay = PendingRequests(hub, KEY)
    client = meeting.connect()
    sender = Sender(client, patience=0.5)

    def wait_for_it() -> None:
        while True:
            if way == "send":
                sender.client.send(b"chunk")
            else:
                sender.client.poll()

    try:
        if way == "send":
            sender.client.post(b"chunk")
            replay.next()
        hub.close()
        with pytest.raises(InputError, match=r"went away and did not come back .* --resume"):
            wait_for_it()
    finally:
        client.close()


class LaterClock:
    """The real one, put forward by ten minutes."""

    sleep = time.sleep

    @staticmethod
    def monotonic() -> float:
        return time.monotonic() + 600.0


def test_patience_counts_from_when_the_hub_last_answered(
    hub: Transport, client: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    replay = PendingRequests(hub, KEY)
    sender = Sender(client, patience=300.0)
    monkeypatch.setattr(insert_client, "time", LaterClock)
    sender.client.send(b"chunk")
    acknowledge(replay.next())
    sender.settled()
    replay.close()
    assert sender.client.poll() is None


def test_patience_begins_anew_once_the_hub_is_back(
    hub: Transport, client: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    sender = Sender(client, patience=300.0)
    assert sender.client.poll() is None
    replay = PendingRequests(hub, KEY)
    polling = sender.beside(sender.client.poll)
    acknowledge(replay.next())
    joined(polling)
    replay.close()
    monkeypatch.setattr(insert_client, "time", LaterClock)
    assert sender.client.poll() is None


def test_people_are_told_that_the_hub_is_away_and_back(
    hub: Transport, client: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("actors.absence._TELL_AFTER", 0.1)
    replay = PendingRequests(hub, KEY)
    sender = Sender(client)
    replay.close()

    def poll_until(warnings: int) -> None:
        while len(sender.warnings) < warnings:
            sender.client.poll()

    joined(sender.beside(lambda: poll_until(1)))
    sender.client.poll()  # says it no second time
    assert sender.warnings == ["a: the hub does not answer: waiting up to 300 s for it."]
    endless = Absence(replace(sender.client._member, patience=math.inf), "hub", "actor")
    endless.lasts(11.0)
    assert sender.warnings.pop() == "a: the hub does not answer: waiting for it."
    replay = PendingRequests(hub, KEY)
    polling = sender.beside(lambda: poll_until(2))
    acknowledge(replay.next())
    joined(polling)
    replay.close()
    assert sender.warnings[1:] == ["a: the hub answers again."]


def test_a_poll_with_a_malformed_reply_is_no_answer(
    replay: PendingRequests, sender: Sender
) -> None:
    answers: list[Ack | None] = []
    polling = sender.beside(lambda: answers.append(sender.client.poll()))
    replay.next().reply(b"garbage")
    joined(polling)
    assert answers == [None]
    (told,) = sender.warnings
    assert told.startswith("a: the replay gave a malformed reply: ")


def test_a_chunk_that_is_refused_for_its_run_counts_as_refused(
    replay: PendingRequests, sender: Sender
) -> None:
    sender.client.post(b"chunk")
    acknowledge(replay.next(), replace(STORED, status="refused", run_id="other"))
    sender.settled()
    assert sender.counts() == (1, 0, 0, 1)
    assert sender.client.last_ack is not None
    assert sender.client.last_ack.run_id == "other"
