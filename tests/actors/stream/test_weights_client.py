"""The inbox for weights, over Zenoh."""

import threading
from collections.abc import Iterator
from typing import Any

import pytest
import zenoh
from zenoh.handlers import Callback

from actors.stream import weights_client as weights_inbox
from actors.stream.weights_client import WeightsClient
from common.protocol.run_keys import RunKeys
from tests.actors.hub_stubs import PendingQueries, refuse
from tests.patience import PATIENCE, wait_until

KEYS = RunKeys("r")


class Broadcast:
    """The learner's side, which knows when all it said has been heard."""

    def __init__(self, hub: zenoh.Session, session: zenoh.Session) -> None:
        self._hub = hub
        self._heard = threading.Event()
        self._marks = session.declare_subscriber(
            KEYS.weights, Callback(self._on_sample, indirect=False)
        )

    def _on_sample(self, sample: zenoh.Sample) -> None:
        if sample.payload.to_bytes() == b"mark":
            self._heard.set()

    def say(self, *messages: tuple[bytes, Any]) -> None:
        """Publish payloads with their attachments; what came before a heard mark was heard."""
        for payload, attachment in messages:
            self._hub.put(KEYS.weights, payload, attachment=attachment)
        self._heard.clear()
        self._hub.put(KEYS.weights, b"mark")  # without a version, so the inbox leaves it
        assert self._heard.wait(PATIENCE)


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """No answer is missed for being slow."""
    monkeypatch.setattr(weights_inbox, "_FETCH_TIMEOUT", PATIENCE)


@pytest.fixture
def inbox(session: zenoh.Session) -> WeightsClient:
    return WeightsClient(session, KEYS)


@pytest.fixture
def broadcast(
    hub: zenoh.Session, session: zenoh.Session, inbox: WeightsClient
) -> Iterator[Broadcast]:
    with hub.declare_publisher(KEYS.weights) as publisher:
        found = Broadcast(hub, session)
        wait_until(
            lambda: publisher.matching_status.matching,  # type: ignore[attr-defined]
            "the hub knows of the inbox",
        )
        yield found


def test_a_broadcast_is_taken_once(broadcast: Broadcast, inbox: WeightsClient) -> None:
    assert inbox.take() is None
    broadcast.say((b"weights", b"3"))
    assert inbox.take() == (3, b"weights")
    assert inbox.take() is None
    broadcast.say((b"others", b"4"))
    assert inbox.take() == (4, b"others")


def test_only_the_latest_is_kept(broadcast: Broadcast, inbox: WeightsClient) -> None:
    broadcast.say((b"three", b"3"), (b"five", b"5"), (b"four", b"4"))  # of a learner that came back
    assert inbox.take() == (4, b"four")
    assert inbox.take() is None


def test_weights_without_a_version_are_left(broadcast: Broadcast, inbox: WeightsClient) -> None:
    for attachment in (None, b"", b"three", b"3.0", b"\xff\xfe", b"9" * 10_000):
        broadcast.say((b"garbage", attachment))
        assert inbox.take() is None
        broadcast.say((b"weights", b"1"), (b"garbage", attachment))
        assert inbox.take() == (1, b"weights")


def test_weights_over_the_bound_are_left(
    broadcast: Broadcast, inbox: WeightsClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(weights_inbox, "MAX_MESSAGE_BYTES", 10)
    broadcast.say((b"x" * 10, b"1"), (b"x" * 11, b"2"))
    assert inbox.take() == (1, b"x" * 10)


def test_a_late_joiner_fetches_the_newest(hub: zenoh.Session, session: zenoh.Session) -> None:
    def serve(query: zenoh.Query) -> None:
        with query:
            query.reply(KEYS.latest_weights, b"weights", attachment=b"12")

    hub.declare_queryable(KEYS.latest_weights, Callback(serve, indirect=False))
    inbox = WeightsClient(session, KEYS)
    assert inbox.take() is None
    inbox.fetch()
    assert inbox.take() == (12, b"weights")


def test_where_there_are_no_weights_yet_fetching_finds_none(
    hub: zenoh.Session, session: zenoh.Session
) -> None:
    inbox = WeightsClient(session, KEYS)
    inbox.fetch()
    assert inbox.take() is None
    asked = PendingQueries(hub, KEYS.latest_weights)
    fetching = threading.Thread(target=inbox.fetch, daemon=True)
    fetching.start()
    refuse(asked.next(), "there are no weights yet")
    fetching.join(PATIENCE)
    assert not fetching.is_alive()
    assert inbox.take() is None


def test_other_runs_weights_do_not_arrive(
    broadcast: Broadcast, hub: zenoh.Session, inbox: WeightsClient
) -> None:
    hub.put(RunKeys("other").weights, b"weights", attachment=b"1")
    broadcast.say()
    assert inbox.take() is None
