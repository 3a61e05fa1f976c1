"""The outbox, over Zenoh: nothing is lost, whatever the other side does."""

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest
import zenoh

from actors.stream import insert_client as outbox_module
from actors.stream.insert_client import InsertClient
from common.errors import InputError, MessageError
from common.protocol.run_keys import RunKeys
from common.transport.bus import connect, open_hub
from tests.actors.hub_stubs import (
    PATIENCE,
    STORED,
    PendingQueries,
    acknowledge,
    answer,
    ignore,
    payload_of,
    refuse,
)
from tests.patience import wait_until

KEY = RunKeys("r").insert("a")
WINDOW = 2


@pytest.fixture
def replay(hub: zenoh.Session) -> Iterator[PendingQueries]:
    questions = PendingQueries(hub, RunKeys("r").insert("*"))
    yield questions
    questions.close()


class Sender:
    """An outbox, what it warned of, and a way to let it wait in a thread of its own."""

    def __init__(self, session: zenoh.Session, patience: float = 300.0) -> None:
        self.stop = threading.Event()
        self.warnings: list[str] = []
        self.outbox = InsertClient(
            session,
            KEY,
            WINDOW,
            patience=patience,
            stopped=self.stop.is_set,
            warn=self.warnings.append,
        )

    def beside(self, work: Callable[[], object]) -> threading.Thread:
        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        return thread

    def counts(self) -> tuple[int, int, int, int]:
        """Made, acknowledged, retried, refused."""
        return self.outbox.made, self.outbox.acked, self.outbox.retried, self.outbox.refused

    def settled(self) -> None:
        wait_until(lambda: self.outbox.unacknowledged == 0, "all is acknowledged")


@pytest.fixture
def sender(
    replay: PendingQueries, session: zenoh.Session, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Sender]:
    monkeypatch.setattr(outbox_module, "ACK_TIMEOUT", PATIENCE)  # whatever holds the test up
    sender = Sender(session)
    yield sender
    sender.stop.set()


def joined(thread: threading.Thread) -> None:
    thread.join(PATIENCE)
    assert not thread.is_alive()


def test_chunks_arrive_and_their_acks_count(replay: PendingQueries, sender: Sender) -> None:
    for number in range(5):
        sender.outbox.post(b"chunk %d" % number)
        query = replay.next()
        assert str(query.key_expr) == KEY
        assert payload_of(query) == b"chunk %d" % number
        ack = replace(STORED, agent_steps=64 * number, weights_version=number)
        acknowledge(query, ack)
        sender.settled()
        assert sender.outbox.last_ack == ack
    assert sender.counts() == (5, 5, 0, 0)
    assert sender.warnings == []


def test_send_returns_while_there_is_room_and_waits_at_the_window(
    replay: PendingQueries, sender: Sender
) -> None:
    sender.outbox.send(b"first")  # returns: one more may be under way
    waiting = sender.beside(lambda: sender.outbox.send(b"second"))
    first, second = replay.next(), replay.next()
    assert [payload_of(first), payload_of(second)] == [b"first", b"second"]
    waiting.join(0.3)
    assert waiting.is_alive()
    assert sender.outbox.unacknowledged == WINDOW
    acknowledge(second)
    joined(waiting)
    assert sender.outbox.unacknowledged == 1
    acknowledge(first)
    sender.settled()
    assert sender.counts() == (2, 2, 0, 0)


def test_never_more_than_the_window_is_under_way(replay: PendingQueries, sender: Sender) -> None:
    sent = [b"%d" % number for number in range(20)]

    def send_all() -> None:
        for payload in sent:
            sender.outbox.send(payload)

    working = sender.beside(send_all)
    arrived: list[bytes] = []
    open_queries: list[zenoh.Query] = []
    while len(arrived) < len(sent):
        open_queries.append(replay.next())
        arrived.append(payload_of(open_queries[-1]))
        # The last answer may have let the next one go already, but never two.
        open_queries += (found := list(replay.waiting()))
        arrived += map(payload_of, found)
        assert len(open_queries) <= WINDOW
        if len(open_queries) == WINDOW or len(arrived) == len(sent):
            acknowledge(open_queries.pop(0))
    for query in open_queries:
        acknowledge(query)
    joined(working)
    sender.settled()
    assert arrived == sent
    assert sender.counts() == (20, 20, 0, 0)


def test_a_wish_to_stop_ends_the_wait(replay: PendingQueries, sender: Sender) -> None:
    sender.outbox.send(b"first")
    waiting = sender.beside(lambda: sender.outbox.send(b"second"))
    first, second = replay.next(), replay.next()
    sender.stop.set()
    joined(waiting)
    assert sender.outbox.unacknowledged == 2
    for query in (first, second):
        ignore(query)


def test_a_query_that_ended_without_an_answer_is_sent_again(
    replay: PendingQueries, sender: Sender
) -> None:
    sender.outbox.post(b"chunk")
    flushing = sender.beside(lambda: sender.outbox.flush(PATIENCE))
    for _ in range(2):
        query = replay.next()
        assert payload_of(query) == b"chunk"
        ignore(query)
    acknowledge(replay.next())
    joined(flushing)
    assert sender.counts() == (1, 1, 2, 0)


def test_an_insert_without_an_answer_is_sent_again_after_its_time(
    replay: PendingQueries, session: zenoh.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(outbox_module, "ACK_TIMEOUT", 0.3)
    sender = Sender(session)
    sender.outbox.post(b"chunk")
    too_late = replay.next()
    flushing = sender.beside(lambda: sender.outbox.flush(PATIENCE))
    again = replay.next()  # comes only if it was sent again
    assert payload_of(too_late) == payload_of(again) == b"chunk"
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


def test_a_refusal_is_told_and_final(replay: PendingQueries, sender: Sender) -> None:
    sender.outbox.post(b"bad chunk")
    refuse(replay.next(), "frames has shape [1] where … is expected")
    sender.settled()
    sender.outbox.post(b"good chunk")
    query = replay.next()
    assert payload_of(query) == b"good chunk"
    acknowledge(query)
    sender.settled()
    assert sender.counts() == (2, 1, 0, 1)
    assert sender.warnings == [
        "the replay refused a chunk: frames has shape [1] where … is expected"
    ]


def test_an_answer_that_is_none_counts_as_a_refusal(replay: PendingQueries, sender: Sender) -> None:
    sender.outbox.post(b"chunk")
    answer(replay.next(), b"garbage")
    sender.settled()
    wait_until(lambda: sender.warnings, "it is told")
    assert sender.counts() == (1, 0, 0, 1)
    assert "an answer that is none" in sender.warnings[0]
    assert sender.outbox.last_ack is None


def test_flush_gives_up_after_its_time(replay: PendingQueries, sender: Sender) -> None:
    sender.outbox.post(b"chunk")
    query = replay.next()
    sender.outbox.flush(0.05)
    assert sender.outbox.unacknowledged == 1
    ignore(query)


def test_a_poll_is_answered_by_what_to_do(replay: PendingQueries, sender: Sender) -> None:
    found: list[object] = []
    polling = sender.beside(lambda: found.append(sender.outbox.poll()))
    query = replay.next()
    assert payload_of(query) == b""
    ack = replace(STORED, status="poll", throttle=True, agent_steps=5)
    acknowledge(query, ack)
    joined(polling)
    assert found == [ack]
    assert sender.outbox.last_ack == ack
    assert sender.counts() == (0, 0, 0, 0)


def test_a_poll_that_nobody_hears_is_no_answer(session: zenoh.Session) -> None:
    sender = Sender(session)
    assert sender.outbox.poll() is None
    assert sender.outbox.last_ack is None


def test_a_hub_that_starts_anew_in_the_middle_gets_everything(endpoint: str) -> None:
    hub = open_hub(endpoint)
    before = PendingQueries(hub, KEY)
    session = connect(endpoint, PATIENCE)
    sender = Sender(session)
    try:
        sender.outbox.send(b"0")
        acknowledge(before.next())
        sender.settled()
        sender.outbox.send(b"1")
        lost = before.next()

        def send_the_rest() -> None:
            for number in range(2, 6):
                sender.outbox.send(b"%d" % number)
            sender.outbox.flush(PATIENCE)

        working = sender.beside(send_the_rest)
        also_lost = before.next()
        hub.close()  # type: ignore[no-untyped-call]
        del lost, also_lost
        hub = open_hub(endpoint)
        after = PendingQueries(hub, KEY)
        stored: set[bytes] = set()

        def done() -> bool:
            for query in after.waiting():  # an answer that came too late is asked for again
                stored.add(payload_of(query))
                acknowledge(query)
            return not working.is_alive()

        wait_until(done, "all is acknowledged")
        assert stored == {b"1", b"2", b"3", b"4", b"5"}
        made, acked, retried, refused = sender.counts()
        assert (made, acked, refused) == (6, 6, 0)
        assert retried >= 2
    finally:
        sender.stop.set()
        session.close()  # type: ignore[no-untyped-call]
        hub.close()  # type: ignore[no-untyped-call]


@pytest.mark.parametrize("way", ["send", "poll"])
def test_patience_with_a_hub_that_went_away_ends(endpoint: str, way: str) -> None:
    hub = open_hub(endpoint)
    replay = PendingQueries(hub, KEY)
    session = connect(endpoint, PATIENCE)
    sender = Sender(session, patience=0.5)

    def wait_for_it() -> None:
        while True:
            if way == "send":
                sender.outbox.send(b"chunk")
            else:
                sender.outbox.poll()

    try:
        if way == "send":
            sender.outbox.post(b"chunk")
            replay.next()
        hub.close()  # type: ignore[no-untyped-call]
        with pytest.raises(InputError, match=r"went away and did not come back .* --resume"):
            wait_for_it()
    finally:
        session.close()  # type: ignore[no-untyped-call]


class LaterClock:
    """The real one, put forward by ten minutes."""

    @staticmethod
    def monotonic() -> float:
        return time.monotonic() + 600.0


def test_patience_counts_from_when_the_hub_last_answered(
    hub: zenoh.Session, session: zenoh.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    replay = PendingQueries(hub, KEY)
    sender = Sender(session, patience=300.0)
    monkeypatch.setattr(outbox_module, "time", LaterClock)
    sender.outbox.send(b"chunk")
    acknowledge(replay.next())
    sender.settled()
    replay.close()
    assert sender.outbox.poll() is None


def test_a_poll_with_an_answer_that_is_none_is_no_answer(
    replay: PendingQueries, sender: Sender
) -> None:
    failed: list[BaseException] = []

    def poll() -> None:
        try:
            sender.outbox.poll()
        except MessageError as error:
            failed.append(error)

    polling = sender.beside(poll)
    answer(replay.next(), b"garbage")
    joined(polling)
    if failed:
        raise failed[0]
