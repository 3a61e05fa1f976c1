"""Actors behind a second router: it is killed and starts again, and then the hub and it do."""

import signal
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager
from queue import SimpleQueue

from benchmarks.child import free_endpoint
from benchmarks.second_router import second_router
from common.protocol.run_keys import RunKeys
from common.transport.interface import Envelope, Requester, Transport, Unanswered
from common.transport.zenoh_sessions import connect, open_hub
from tests.patience import PATIENCE, wait_until

KEYS = RunKeys("r")
Presence = SimpleQueue[tuple[str, bool]]


@contextmanager
def hub_at(endpoint: str) -> Iterator[tuple[Transport, Presence]]:
    """A hub that acknowledges chunks, and who it hears has come or gone."""
    presence: Presence = SimpleQueue()
    with open_hub(endpoint) as hub:
        hub.serve(KEYS.insert("*"), lambda request: request.payload[::-1])
        hub.watch_presence(KEYS.live("*", "*"), lambda *news: presence.put(news))
        yield hub, presence


def outcome(future: Future[Envelope]) -> bytes | None:
    try:
        return future.result().payload
    except Unanswered:
        return None


def check_both_ways(hub: Transport, inserts: Requester, weights: SimpleQueue[bytes]) -> None:
    """A chunk is acknowledged, and new weights arrive."""
    answer = wait_until(lambda: outcome(inserts.request(b"chunk")), "a chunk is acknowledged")
    assert answer == b"knuhc"
    publisher = hub.publisher(KEYS.weights)

    def arrive() -> bool:
        publisher.publish(b"weights")
        return not weights.empty()

    wait_until(arrive, "weights arrive")
    while not weights.empty():
        assert weights.get() == b"weights"


def test_a_run_behind_a_second_router_outlasts_that_ones_end_and_the_hubs(endpoint: str) -> None:
    here, there = (KEYS.live("actor", "a"), True), (KEYS.live("actor", "a"), False)
    weights: SimpleQueue[bytes] = SimpleQueue()
    place = free_endpoint()
    with ExitStack() as stack:
        router = stack.enter_context(second_router(place, endpoint))
        with hub_at(endpoint) as (hub, presence):  # it joins a hub that begins later
            actor = stack.enter_context(connect(place, PATIENCE))
            actor.subscribe(KEYS.weights, lambda sent: weights.put(sent.payload))
            inserts = actor.requester(KEYS.insert("a"), 10.0)  # then it is asked again
            actor.announce(KEYS.live("actor", "a"))
            assert presence.get(timeout=PATIENCE) == here
            check_both_ways(hub, inserts, weights)
            router.send_signal(signal.SIGKILL)
            assert presence.get(timeout=PATIENCE) == there
            router = stack.enter_context(second_router(place, endpoint))
            assert presence.get(timeout=PATIENCE) == here
            check_both_ways(hub, inserts, weights)
        with hub_at(endpoint) as (hub, presence):
            # By Zenoh 1.10.2 a router often does not tell a hub that came back of tokens and
            # subscriptions that it told the former one of.
            router.send_signal(signal.SIGKILL)
            stack.enter_context(second_router(place, endpoint))
            assert presence.get(timeout=PATIENCE) == here
            check_both_ways(hub, inserts, weights)
