"""The weights client."""

import threading

import pytest

from actors.stream import weights_client
from actors.stream.weights_client import WeightsClient
from common.protocol.run_keys import RunKeys
from common.transport.interface import Envelope, Request, Transport
from tests.hub_stubs import PendingRequests
from tests.patience import PATIENCE

KEYS = RunKeys("r")


class Broadcast:
    """The learner's side, which knows when all it said has been heard."""

    def __init__(self, hub: Transport, client: Transport) -> None:
        self._publisher = hub.publisher(KEYS.weights)
        self._heard = threading.Event()
        client.subscribe(KEYS.weights, self._hear)

    def _hear(self, message: Envelope) -> None:
        if message.payload == b"mark":
            self._heard.set()

    def say(self, *messages: tuple[bytes, bytes]) -> None:
        """Publish payloads with their attachments; what came before a heard mark was heard."""
        for payload, attachment in messages:
            self._publisher.publish(payload, attachment)
        self._heard.clear()
        self._publisher.publish(b"mark")  # without a version, so the client leaves it
        assert self._heard.wait(PATIENCE)


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """No answer is missed for being slow."""
    monkeypatch.setattr(weights_client, "_FETCH_TIMEOUT", PATIENCE)
    monkeypatch.setattr(weights_client, "_FETCH_PERIOD", 0.0)


@pytest.fixture
def weights(client: Transport) -> WeightsClient:
    return WeightsClient(client, KEYS)


@pytest.fixture
def broadcast(hub: Transport, client: Transport, weights: WeightsClient) -> Broadcast:
    return Broadcast(hub, client)


def test_a_broadcast_is_taken_once(broadcast: Broadcast, weights: WeightsClient) -> None:
    assert weights.take() is None
    broadcast.say((b"weights", b"3"))
    assert weights.take() == (3, b"weights", b"")
    assert weights.take() is None
    broadcast.say((b"others", b"4"))
    assert weights.take() == (4, b"others", b"")


def test_only_the_latest_is_kept(broadcast: Broadcast, weights: WeightsClient) -> None:
    broadcast.say((b"three", b"3"), (b"five", b"5"), (b"four", b"4"))  # of a learner that came back
    assert weights.take() == (4, b"four", b"")
    assert weights.take() is None


def test_weights_without_a_version_are_left(broadcast: Broadcast, weights: WeightsClient) -> None:
    for attachment in (b"", b"three", b"3.0", b"\xff\xfe", b"9" * 10_000):
        broadcast.say((b"garbage", attachment))
        assert weights.take() is None
        broadcast.say((b"weights", b"1"), (b"garbage", attachment))
        assert weights.take() == (1, b"weights", b"")


def test_weights_over_the_bound_are_left(
    broadcast: Broadcast, weights: WeightsClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(weights_client, "MAX_MESSAGE_BYTES", 10)
    broadcast.say((b"x" * 10, b"1"), (b"x" * 11, b"2"))
    assert weights.take() == (1, b"x" * 10, b"")


def test_a_late_joiner_fetches_the_newest(hub: Transport, client: Transport) -> None:
    hub.serve(KEYS.latest_weights, lambda _: Envelope(b"weights", b"12"))
    weights = WeightsClient(client, KEYS)
    assert weights.take() is None
    weights.fetch()
    assert weights.take() == (12, b"weights", b"")


def test_an_answer_does_not_replace_what_was_broadcast_meanwhile(
    broadcast: Broadcast, hub: Transport, weights: WeightsClient
) -> None:
    asked = PendingRequests(hub, KEYS.latest_weights)
    for meanwhile, version in (((b"new", b"15"),), 15), (((b"garbage", b""),), 10):
        fetching = threading.Thread(target=weights.fetch, daemon=True)
        fetching.start()
        request = asked.next()
        broadcast.say(*meanwhile)
        request.reply(Envelope(b"old", b"10"))
        fetching.join(PATIENCE)
        taken = weights.take()
        assert taken is not None
        assert taken[0] == version


def test_nobody_asks_more_often_than_a_hub_answers(
    hub: Transport, client: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A question that the hub drops would hold the actor up for seconds."""
    monkeypatch.setattr(weights_client, "_FETCH_PERIOD", PATIENCE)
    asked: list[bytes] = []

    def note(request: Request) -> bytes:
        asked.append(request.payload)
        return b""

    hub.serve(KEYS.latest_weights, note)
    weights = WeightsClient(client, KEYS)
    for _ in range(3):
        weights.fetch()
    assert len(asked) == 1


def test_where_there_are_no_weights_yet_fetching_finds_none(
    hub: Transport, client: Transport
) -> None:
    weights = WeightsClient(client, KEYS)
    weights.fetch()
    assert weights.take() is None
    asked = PendingRequests(hub, KEYS.latest_weights)
    fetching = threading.Thread(target=weights.fetch, daemon=True)
    fetching.start()
    asked.next().refuse("there are no weights yet")
    fetching.join(PATIENCE)
    assert not fetching.is_alive()
    assert weights.take() is None


def test_other_runs_weights_do_not_arrive(
    broadcast: Broadcast, hub: Transport, weights: WeightsClient
) -> None:
    hub.publisher(RunKeys("other").weights).publish(b"weights", b"1")
    broadcast.say()
    assert weights.take() is None
    broadcast.say((b"weights", b"1 another"))  # begun under this one's name
    assert weights.take() is None
