"""A transport defined here and known to nobody, on which replay, actor and learner meet.

It has no threads, queues or deadlines: a server answers in the thread of whoever asks.
"""

import fnmatch
import threading
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any, Self

import numpy as np

from actors.member import Member
from actors.stream.insert_client import InsertClient
from actors.stream.weights_client import WeightsClient
from common.errors import MessageError
from common.protocol.run_keys import RunKeys
from common.registry import ENVIRONMENTS
from common.run.join import find_run
from common.transport.interface import Answer, Closeable, Envelope, Publisher, Requester, Unanswered
from replay.client import RemoteReplay
from replay.replay_buffer import ReplayBuffer
from replay.server import ReplayServer
from tests.extending.test_environment import CONFIG, LAMPS
from tests.extending.whole_run import added, learned
from tests.replay.replay_reference import GOES_ON, RUN, Actor, make_config


class Entry:
    """Something in a list, until it is closed."""

    def __init__(
        self, place: list[Any], entry: Any, end: Callable[[], None] = lambda: None
    ) -> None:
        self._place, self._entry, self._end = place, entry, end
        place.append(entry)

    def close(self) -> None:
        if self._entry in self._place:
            self._place.remove(self._entry)
            self._end()


class DirectRequest:
    """Ends as its server says."""

    def __init__(self, key: str, payload: bytes, future: Future[Envelope]) -> None:
        self.key, self.payload, self.size = key, payload, len(payload)
        self._future = future

    def reply(self, answer: bytes | Envelope) -> None:
        payload, attachment, _ = answer if isinstance(answer, Envelope) else Envelope(answer)
        if not self._future.done():
            self._future.set_result(Envelope(payload, attachment, self.key))

    def refuse(self, reason: str) -> None:
        self._fail(MessageError(reason))

    def drop(self) -> None:
        self._fail(Unanswered())

    def _fail(self, error: Exception) -> None:
        if not self._future.done():
            self._future.set_exception(error)


class DirectTransport:
    """Implements `Transport` for all who hold it."""

    def __init__(self) -> None:
        self._services: list[tuple[str, Answer]] = []
        self._subscriptions: list[tuple[str, Callable[[Envelope], None]]] = []
        self._present: list[str] = []
        self._watches: list[tuple[str, Callable[[str, bool], None]]] = []

    def serve(self, key: str, answer: Answer) -> Closeable:
        return Entry(self._services, (key, answer))

    def requester(self, key: str, deadline: float) -> Requester:
        return DirectRequester(self, key)

    def gather(self, key: str, deadline: float, payload: bytes = b"") -> list[Envelope]:
        found = [self.ask(served, payload, answer) for served, answer in self.at(key)]
        return [future.result() for future in found if future.exception() is None]

    def publisher(self, key: str) -> Publisher:
        return DirectPublisher(self._subscriptions, key)

    def subscribe(self, key: str, callback: Callable[[Envelope], None]) -> Closeable:
        return Entry(self._subscriptions, (key, callback))

    def announce(self, key: str) -> Closeable:
        def tell(present: bool) -> None:
            for watched, callback in self._watches:
                if fnmatch.fnmatch(key, watched):
                    callback(key, present)

        tell(True)
        return Entry(self._present, key, lambda: tell(False))

    def watch_presence(self, key: str, callback: Callable[[str, bool], None]) -> Closeable:
        for present in fnmatch.filter(self._present, key):
            callback(present, True)
        return Entry(self._watches, (key, callback))

    def note_over_quota(self, name: str) -> None: ...

    def watch_shut_out(self, callback: Callable[[str, str], None]) -> Closeable:
        return Entry([], ("", callback))

    def close(self) -> None: ...

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None: ...

    def at(self, key: str) -> list[tuple[str, Answer]]:
        return [
            (served, answer)
            for served, answer in self._services
            if fnmatch.fnmatch(key, served) or fnmatch.fnmatch(served, key)
        ]

    def ask(self, key: str, payload: bytes, answer: Answer) -> Future[Envelope]:
        future: Future[Envelope] = Future()
        request = DirectRequest(key, payload, future)
        try:
            if (found := answer(request)) is not None:
                request.reply(found)
        except MessageError as error:
            request.refuse(str(error))
        return future


class DirectRequester:
    """Implements `interface.Requester`."""

    def __init__(self, transport: DirectTransport, key: str) -> None:
        self._transport, self._key = transport, key

    @property
    def has_server(self) -> bool:
        return bool(self._transport.at(self._key))

    def request(self, payload: bytes) -> Future[Envelope]:
        for _, answer in self._transport.at(self._key):
            return self._transport.ask(self._key, payload, answer)
        future: Future[Envelope] = Future()
        future.set_exception(Unanswered())
        return future

    def close(self) -> None: ...


class DirectPublisher:
    """Implements `interface.Publisher`."""

    def __init__(self, listeners: list[tuple[str, Callable[[Envelope], None]]], key: str) -> None:
        self._listeners, self._key = listeners, key

    def publish(self, payload: bytes, attachment: bytes = b"") -> None:
        for key, callback in self._listeners:
            if fnmatch.fnmatch(self._key, key):
                callback(Envelope(payload, attachment, self._key))

    def close(self) -> None: ...


def test_a_run_is_played_and_learned_on_a_transport_from_outside(tmp_path: Path) -> None:
    transport = DirectTransport()
    with added(ENVIRONMENTS, LAMPS):
        summary, policy = learned(CONFIG, tmp_path, steps=240, connect=lambda: transport)
    assert summary["agent_steps"] >= 240
    assert summary["updates"] > 0
    assert policy.weights_version > 0
    [actor] = summary["actors"]  # it was seen to leave, and its last heartbeat came
    assert (actor["name"], actor["alive"]) == ("a", False)
    assert actor["steps"] == summary["agent_steps"]
    assert actor["acked"] == summary["chunks"]["acked"] > 0


def test_a_remote_replay_and_an_actors_clients_meet_on_a_transport_from_outside(
    tmp_path: Path,
) -> None:
    transport, keys = DirectTransport(), RunKeys(RUN, RUN)
    config = make_config(capacity=256, learning_starts=20, ratio_tolerance=64, chunk_steps=8)
    buffer = ReplayBuffer(config, tmp_path)
    buffer.run_id = RUN
    with ReplayServer(transport, buffer, config, RUN):
        assert find_run(transport, None, 0.0, lambda: True) == (keys, config)
        transport.publisher(keys.weights).publish(b"weights", b"50 " + RUN.encode())

        weights = WeightsClient(transport, keys)
        weights.fetch()
        assert weights.take() == (50, b"weights", b"")

        warnings: list[str] = []
        inserts = InsertClient(
            Member("a", transport, keys, config, 0.0, threading.Event(), 1, warnings.append)
        )
        chunk = Actor("a", 4).live([GOES_ON] * 30, np.random.default_rng(0))
        inserts.send(chunk.encode())
        inserts.send(b"junk")
        assert (inserts.made, inserts.acked, inserts.refused) == (2, 1, 1)
        assert inserts.last_ack is not None
        assert inserts.last_ack.weights_version == 50
        assert "refused a chunk" in warnings[0]

        replay = RemoteReplay(transport, keys, config)
        batch = replay.sample(0, 1.0)
        assert batch is not None
        assert {int(action) for action in batch.a_tm1} <= set(chunk.actions.tolist())
        assert replay.progress(0).agent_steps == 30
    assert replay.sample(0, 0.0) is None, "a server that is away"
    buffer.close()
