"""Who floods a hub, and who does not: over real connections, and by a clock of the test's."""

from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import ExitStack
from pathlib import Path

import pytest

from common.protocol.run_keys import RunKeys
from common.settings.config import MAX_WINDOW
from common.transport import flood_guard
from common.transport.flood_guard import CUT_OFF, FloodGuard, tolerated
from common.transport.hub_sockets import Address
from common.transport.interface import Envelope, Request, Requester, Transport, Unanswered
from common.transport.leaky_bucket import ACTOR_QUOTA, LeakyBucket
from common.transport.requests import Window
from common.transport.zenoh_sessions import connect, open_hub
from common.transport.zenoh_transport import ZenohTransport
from tests.patience import PATIENCE, wait_until

KEYS = RunKeys("r")
MEGABYTE = bytes(2**20)


class Crowd:
    """A hub that takes 0.1 MB/s, or ``most`` bytes/s, and clients of it."""

    def __init__(self, stack: ExitStack, address: str, folder: Path, most: float = 1e5) -> None:
        self._stack, self._address, self._folder = stack, address, folder
        self.hub: ZenohTransport = stack.enter_context(open_hub(address, folder, most))

    def actor(self, name: str) -> Requester:
        client = connect(self._address, PATIENCE, name=name, certificates=self._folder)
        # What is sent over a connection that is ignored gets no answer: ask again, as actors do.
        return self._stack.enter_context(client).requester(KEYS.insert(name), 5.0)

    def learner(self) -> Transport:
        client = connect(self._address, PATIENCE, role="learner", certificates=self._folder)
        return self._stack.enter_context(client)

    def links(self, name: str) -> list[str]:
        links = self.hub.session.info.links()
        return [link.dst for link in links if link.auth_identifier == name]


@pytest.fixture
def crowd(address: str, named: Path) -> Iterator[Crowd]:
    with ExitStack() as stack:
        crowd = Crowd(stack, address, named)
        crowd.hub.serve(KEYS.all, lambda _: b"ok")
        yield crowd


def flood(actor: Requester) -> None:
    """Returns when it is cut off."""

    def is_out() -> bool:
        actor.request(MEGABYTE).exception()
        return not actor.has_server

    wait_until(is_out, "the flooder is cut off")


def test_who_floods_a_hub_is_cut_off_and_the_others_are_not(
    crowd: Crowd, caplog: pytest.LogCaptureFixture
) -> None:
    left, right, learner = crowd.actor("left"), crowd.actor("right"), crowd.learner()
    assert right.request(b"").result().payload == b"ok"
    before = crowd.links("actor.right"), crowd.links("learner")
    assert list(map(len, before)) == [1, 1]
    samples = learner.requester(KEYS.sample, PATIENCE)
    for _ in range(3):
        assert samples.request(MEGABYTE).result().payload == b"ok"
    flood(left)
    again = crowd.actor("left")  # is let in, and out at once, although it sends nothing
    wait_until(lambda: not again.has_server, "the flooder is out again")
    assert (crowd.links("actor.right"), crowd.links("learner")) == before
    assert right.request(b"").result().payload == b"ok"
    assert "actor.left sends more than 0 MB/s, or 1 requests/s over its quota: " in caplog.text
    assert "its connections are ended for 60 s" in caplog.text
    assert caplog.text.count("sends more") == 1


def test_who_sends_over_its_quota_again_and_again_is_cut_off(address: str, named: Path) -> None:
    with ExitStack() as stack:
        crowd = Crowd(stack, address, named, most=1e6)

        def answer(request: Request) -> bytes | None:
            if request.key.endswith("left"):
                return b"ok"
            crowd.hub.note_over_quota("right")
            request.drop()
            return None

        crowd.hub.serve(KEYS.insert("*"), answer)
        left, right = crowd.actor("left"), crowd.actor("right")
        before = crowd.links("actor.left")

        def is_out() -> bool:
            for _ in range(50):
                right.request(b"").exception()
            return not right.has_server

        wait_until(is_out, "who asks too often is cut off")
        assert crowd.links("actor.left") == before
        assert left.request(b"").result().payload == b"ok"


def test_who_floods_no_more_is_heard_again(crowd: Crowd, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flood_guard, "CUT_OFF", 1.0)
    left = crowd.actor("left")
    flood(left)
    wait_until(lambda: left.request(b"").exception() is None, "the flooder is heard")


class Links:
    """Connections that the test makes up, and a clock."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        self.received: dict[Address, int] = {}
        self.ended: list[Address] = []
        monkeypatch.setattr(flood_guard, "bytes_received", lambda _: dict(self.received))
        monkeypatch.setattr(flood_guard, "end_connections", lambda _, some: self.ended.extend(some))
        self.ignored: list[Address] = []
        ignore = self.ignored.extend
        monkeypatch.setattr(flood_guard, "ignore_connections", lambda _, some: ignore(some))
        self.guard = FloodGuard(7, {"learner"}, 100.0, lambda: self.now)
        self.guard.close()  # this test looks itself

    def join(self, name: str, port: int, *, leaves: bool = False) -> None:
        self.guard.hear(name, ("::1", port), not leaves)

    def send(self, port: int, count: int, seconds: float = 1.0) -> list[int]:
        """Returns the ports that are ended, after so many seconds."""
        self.now += seconds
        self.received["::1", port] = self.received.get(("::1", port), 0) + count
        self.ended.clear()
        self.guard.look()
        return sorted(port for _, port in self.ended)


@pytest.fixture
def links(monkeypatch: pytest.MonkeyPatch) -> Links:
    return Links(monkeypatch)


def test_what_one_sends_within_its_measure_is_taken_for_ever(links: Links) -> None:
    links.join("a", 1)
    assert [links.send(1, 100) for _ in range(20)] == [[]] * 20
    assert links.send(1, 300) == []  # 2 s ahead, as after a pause
    assert links.send(1, 0, 2.0) == []
    assert links.send(1, 300) == []
    assert links.send(1, 101) == [1]


def test_an_actors_connections_count_together(links: Links) -> None:
    links.join("a", 1)
    links.join("a", 2)
    links.join("b", 3)
    for port in (1, 3):
        assert links.send(port, 200, 0.0) == []
    assert links.send(2, 1, 0.0) == [1, 2]
    assert links.send(3, 0, 0.0) == []


def test_requests_over_a_quota_count_as_many_bytes(
    links: Links, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(flood_guard, "_OVER_QUOTA", 10)
    links.join("a", 1)
    links.join("b", 2)
    for name, count in (("a", 10), ("b", 31), ("unknown", 99)):
        for _ in range(count):
            links.guard.note_over_quota(name)
    assert links.send(1, 200) == [2]  # of 100 a second, and two seconds' at once
    assert links.send(1, 1, 0.0) == [1]


def test_who_has_left_at_each_look_is_cut_off_too(
    links: Links, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(flood_guard, "_OVER_QUOTA", 10)
    links.join("b", 2)
    for _ in range(5):
        links.join("a", 1)
        for _ in range(20):
            links.guard.note_over_quota("a")
        links.join("a", 1, leaves=True)
        links.send(2, 0)
    links.join("a", 3)
    assert ("::1", 3) in links.ignored


@pytest.mark.parametrize(
    ("quota", "chunk_steps", "speed"), [(1_000, 4, 5.0), (2_000, 8, 5.0), (5_000, 16, 9.0)]
)
def test_an_actor_over_a_small_quota_is_not_cut_off(
    links: Links, monkeypatch: pytest.MonkeyPatch, quota: int, chunk_steps: int, speed: float
) -> None:
    """It plays ``speed`` steps per millisecond, in small chunks and with the largest window."""
    links.guard.most = tolerated(quota)
    links.join("a", 1)
    bucket = LeakyBucket(quota, lambda: links.now)
    monkeypatch.setattr("common.transport.requests.time.monotonic", lambda: links.now)

    class Hub:
        has_server = True

        def close(self) -> None: ...

        def request(self, payload: bytes) -> Future[Envelope]:
            answer: Future[Envelope] = Future()
            if bucket.admits("a", chunk_steps):
                answer.set_result(Envelope(b"", b"", ""))
            else:
                links.guard.note_over_quota("a")
                answer.set_exception(Unanswered("over quota"))
            return answer

    window = Window(Hub(), lambda _: None)
    played = 0.0
    for tick in range(60_000):  # of a millisecond
        links.now += 0.001
        window.wait(MAX_WINDOW, 0.0)
        played = min(played + speed, 64.0 * chunk_steps)
        while played >= chunk_steps and len(window) < MAX_WINDOW:
            window.send(b"chunk")
            played -= chunk_steps
        if tick % 1_000 == 0:
            assert links.send(1, 0, 0.0) == []
    assert window.sent_again > 1_000


def test_a_connection_that_one_reading_misses_counts_only_what_is_new(links: Links) -> None:
    links.join("a", 1)
    assert [links.send(1, 100) for _ in range(20)] == [[]] * 20
    found = links.received.pop(("::1", 1))
    links.join("b", 2)
    assert links.send(2, 0) == []
    links.received["::1", 1] = found
    assert links.send(1, 200) == []
    assert links.send(1, 301) == [1]


def test_who_connects_anew_is_as_far_ahead_as_before(links: Links) -> None:
    links.join("a", 1)
    assert links.send(1, 200, 0.0) == []
    del links.received["::1", 1]
    links.join("a", 2)  # before it is known that the first has ended
    assert links.send(2, 1, 0.0) == [1, 2]


def test_who_was_cut_off_is_ignored_and_then_ended_until_its_time_is_over(links: Links) -> None:
    links.join("a", 1)
    assert links.send(1, 301) == [1]
    links.join("a", 1, leaves=True)
    links.now += CUT_OFF - 2
    links.join("b", 2)
    links.join("a", 3)
    assert (links.ignored, links.send(2, 0)) == ([("::1", 3)], [3])
    assert links.send(2, 0, 0.0) == []
    links.join("a", 4)
    links.join("a", 4, leaves=True)
    links.join("a", 5)
    assert links.send(2, 0) == [5]  # nobody is ignored for ever
    links.join("a", 6)
    assert (links.ignored, links.send(2, 0)) == ([("::1", port) for port in (3, 4, 5)], [])


def test_who_is_trusted_is_not_watched(links: Links) -> None:
    links.join("learner", 1)
    assert links.send(1, 1_000) == []


def test_a_quota_bounds_what_is_received_too() -> None:
    assert tolerated(ACTOR_QUOTA) == tolerated(1) == 15_000 * 84 * 84
    assert tolerated(2 * ACTOR_QUOTA) == 30_000 * 84 * 84


def test_nothing_is_asked_of_connections_that_nobody_watches(
    links: Links, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks: list[int] = []

    def nothing_received(port: int) -> dict[Address, int]:
        looks.append(port)
        return {}

    monkeypatch.setattr(flood_guard, "bytes_received", nothing_received)
    links.join("learner", 1)
    links.guard.look()
    assert looks == []
    links.join("a", 2)
    links.guard.look()
    assert looks == [7]
    links.join("a", 2, leaves=True)
    links.guard.look()
    assert looks == [7]
