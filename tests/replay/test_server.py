"""Replay server and remote replay."""

import errno
import json
import logging
import os
import random
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast
from unittest.mock import Mock, PropertyMock, create_autospec

import numpy as np
import pytest

from actors.member import Member
from actors.stream.insert_client import InsertClient
from common.errors import InputError, MessageError
from common.process.log_lines import kept_log
from common.protocol.ack import Ack
from common.protocol.run_keys import DEMONSTRATIONS, RunKeys
from common.protocol.wire import pack
from common.run.join import find_run
from common.settings.config import StreamConfig
from common.transport.interface import Envelope, Request, Transport, Unanswered
from common.transport.leaky_bucket import ACTOR_QUOTA, NEW_NAMES_PER_SECOND, LeakyBucket
from replay import server as replay_server
from replay.client import AHEAD, MAX_PRIORITY_UPDATES, RemoteReplay
from replay.messages import (
    MAX_PRIORITIES,
    NO_BATCH,
    HeldOutStates,
    ProgressRequest,
    SampleRequest,
)
from replay.replay_buffer import ReplayBuffer
from replay.server import ReplayServer
from tests.hub_stubs import PendingRequests
from tests.in_process_transport import InProcessTransport
from tests.patience import PATIENCE
from tests.replay.replay_reference import (
    GOES_ON,
    RUN,
    TERMINATES,
    TRUNCATES,
    Actor,
    make_config,
)
from tests.replay.replay_requests import KEYS, ask, insert


def until_late() -> Iterator[None]:
    """Turns until it is too late."""
    ends = time.monotonic() + PATIENCE
    while time.monotonic() < ends:
        yield
        time.sleep(0.001)


@dataclass
class Place:
    """A served replay, and a client's transport."""

    buffer: ReplayBuffer
    server: ReplayServer
    hub: Transport
    client: Transport
    remote: RemoteReplay

    def serve_anew(self, quota: float = ACTOR_QUOTA) -> None:
        self.server.close()
        self.server = ReplayServer(self.hub, self.buffer, make_config(), RUN, quota)


@pytest.fixture
def stopped_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock of the quotas of servers that begin to serve from now on."""
    monkeypatch.setattr(
        replay_server, "LeakyBucket", lambda per_second: LeakyBucket(per_second, lambda: 0.0)
    )


@pytest.fixture
def place(tmp_path: Path, hub: Transport, client: Transport) -> Iterator[Place]:
    config = make_config(
        capacity=256,
        learning_starts=20,
        ratio_tolerance=64,
        sampler="prioritised",
        chunk_steps=8,
        window=2,
    )
    buffer = ReplayBuffer(config, tmp_path)
    buffer.run_id = RUN
    remote = RemoteReplay(client, KEYS, config)
    place = Place(buffer, ReplayServer(hub, buffer, config, RUN), hub, client, remote)
    try:
        yield place
    finally:
        remote.close()
        place.server.close()
        buffer.close()


def test_the_hub_announces_its_run(place: Place) -> None:
    keys, config = find_run(place.client, None, PATIENCE)
    assert keys == KEYS
    assert config.replay.capacity == 256


def test_what_is_inserted_is_acknowledged_drawn_and_counted(place: Place) -> None:
    actor, rng = Actor("a", 4), np.random.default_rng(0)
    chunk = actor.live([GOES_ON] * 20 + [TERMINATES], rng)
    assert place.remote.sample(0, 0.0) is None
    assert insert(place.client, chunk) == Ack("stored", False, False, 21, 1.0, 0, RUN)
    assert insert(place.client, chunk).status == "duplicate"
    batch = place.remote.sample(0, PATIENCE)
    assert batch is not None
    assert batch.s_tm1.shape == (16, 4, 84, 84)
    for at, id_ in enumerate(batch.ids):
        assert (batch.s_tm1[at, -1] == chunk.frames[id_]).all()
        assert batch.a_tm1[at] == chunk.actions[id_]
    place.remote.update_priorities(np.arange(21), np.eye(21, dtype=np.float32)[7] * 1e9)
    for _ in range(1 + AHEAD):  # as many were asked for before
        batch = place.remote.sample(16, PATIENCE)
        assert batch is not None
    assert set(batch.ids.tolist()) == {7}
    frames, vectors = place.remote.held_out(2)
    assert len(frames) == len(vectors) <= 2
    progress = place.remote.progress(0)
    assert (progress.accepted, progress.duplicates, progress.refused) == (1, 1, 0)
    assert progress.statistics == place.buffer.progress(0).statistics
    assert place.remote.progress(1, goal=22).statistics == ()
    assert insert(place.client, actor.live([GOES_ON], rng)).finished


def test_a_chunk_at_another_actors_key_is_refused(
    place: Place, caplog: pytest.LogCaptureFixture
) -> None:
    chunk = Actor("a", 4).live([GOES_ON], np.random.default_rng(0))
    for _ in range(3):
        with pytest.raises(MessageError, match="it names a as its actor"):
            ask(place.client, KEYS.insert("forger"), chunk.encode())
    assert place.buffer.progress(0).refused == 3
    told = [each for each in caplog.messages if "forger" in each]
    assert told == ["a chunk of forger was refused: it names a as its actor"]


@pytest.mark.parametrize("name", ["a" * 65, "a" * 60_000, "*", "é", "a\nb", "-a"])
def test_a_name_that_no_actor_can_have_is_neither_kept_nor_logged(
    place: Place, caplog: pytest.LogCaptureFixture, name: str
) -> None:
    for payload in (b"", b"chunk"):
        with pytest.raises(MessageError, match="no process can have the name in this key"):
            ask(place.client, KEYS.insert(name), payload)
    assert not caplog.messages
    assert not place.server._quota.knows(name)


def test_who_was_refused_is_kept(place: Place, tmp_path: Path) -> None:
    chunk = Actor("b", 4).live([TERMINATES], np.random.default_rng(0))
    with kept_log(tmp_path / "kept.jsonl", "replay"):
        with pytest.raises(MessageError):
            ask(place.client, KEYS.insert("liar"), chunk.encode())
        assert insert(place.client, chunk).status == "stored"
        place.buffer.update_priorities(np.arange(1), np.full(1, np.nan, np.float32))
        place.server.close()
        place.server = ReplayServer(place.hub, place.buffer, make_config(), RUN, quota=1e-9)
        insert(place.client, chunk)
        with pytest.raises(Unanswered):
            insert(place.client, chunk)
    kept = [json.loads(line) for line in (tmp_path / "kept.jsonl").read_text().splitlines()]
    assert [each["message"] for each in kept] == [
        "a chunk of liar was refused: it names b as its actor",
        "steps 0 of b are not drawn again: their loss is not finite",
        "b sends more than --actor-quota allows: the rest has to wait",
    ]
    assert all(each["time"] for each in kept)


def test_an_actor_over_its_quota_waits_alone_and_loses_nothing(
    place: Place, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    seconds = [0.0]
    monkeypatch.setattr(
        replay_server, "LeakyBucket", lambda per_second: LeakyBucket(per_second, lambda: seconds[0])
    )
    place.server.close()
    config = replace(make_config(), stream=StreamConfig(chunk_steps=8, window=3))
    place.server = ReplayServer(place.hub, place.buffer, config, RUN, quota=7)
    rng, stop = np.random.default_rng(0), threading.Event()
    sender = InsertClient(Member("fast", place.client, KEYS, config, PATIENCE, stop))
    fast, other = Actor("fast", 4), Actor("other", 4)
    for _ in range(3):
        sender.post(fast.live([GOES_ON] * 8, rng).encode())
    for _ in until_late():
        if place.buffer.over_quota:
            break
    # Eight steps are more than a second's, however small they travel, so the next has to wait.
    assert place.buffer.progress(0).accepted == 1
    told = place.remote.progress(0).values()["stream/over_quota"]
    assert isinstance(told, int)
    assert 0 < told <= place.buffer.over_quota  # it is sent again and again
    with pytest.raises(Unanswered):
        ask(place.client, KEYS.insert("fast"), b"")
    given = Actor(DEMONSTRATIONS, 4)  # the learner's own have no measure
    for chunk in (each.live([GOES_ON] * 8, rng) for each in (other, given, given)):
        assert insert(place.client, chunk).status == "stored"
    for _ in until_late():
        seconds[0] += 1.0
        sender.flush(0.1)
        if not sender.unacknowledged:
            break
    assert (sender.acked, sender.refused, place.buffer.progress(0).accepted) == (3, 0, 6)
    assert caplog.messages == [
        "fast sends more than --actor-quota allows: the rest has to wait",
    ]


@pytest.mark.parametrize("compresses", [True, False])
@pytest.mark.usefixtures("stopped_clock")
def test_a_quota_counts_all_frames_whether_they_compress_or_not(
    place: Place, compresses: bool
) -> None:
    place.serve_anew(quota=40)
    actor, rng = Actor("a", 4), np.random.default_rng(0)
    taken = 0
    with suppress(Unanswered):
        for _ in range(20):
            chunk = actor.live([GOES_ON] * 4 + [TRUNCATES] * 4, rng)
            if compresses:
                chunk = replace(
                    chunk,
                    frames=np.zeros_like(chunk.frames),
                    final_frames=np.zeros_like(chunk.final_frames),
                )
            insert(place.client, chunk)
            taken += 1
    # The first has 8 frames and 4 final ones, the others a context too; a second's come at once,
    # and the one that is more is paid for.
    assert taken == 4
    assert cast(InProcessTransport, place.hub).over_quota == {"a": 1}


@pytest.mark.usefixtures("stopped_clock")
def test_new_names_with_large_chunks_count_as_several(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    place.serve_anew()
    # Its warnings come seldom, and another test waits for one.
    monkeypatch.setattr(replay_server, "_log", logging.getLogger("unheard"))
    black = np.zeros((1, 84, 84), np.uint8)
    admitted = 0
    with suppress(Unanswered):
        for number in range(int(NEW_NAMES_PER_SECOND)):
            chunk = Actor(f"a{number}", 4).live([GOES_ON] * 640, np.random.default_rng(0))
            chunk = replace(chunk, frames=np.repeat(black, 640, axis=0))
            with suppress(MessageError):
                insert(place.client, chunk)
            admitted += 1
    assert admitted == pytest.approx(NEW_NAMES_PER_SECOND / 10, abs=2)


@pytest.mark.usefixtures("stopped_clock")
def test_a_malformed_chunk_counts_as_much_as_the_longest(place: Place) -> None:
    """It may have taken as long to decompress."""
    place.serve_anew(quota=3_300)
    for _ in range(2):  # a second's come at once, and the one that is more is paid for
        with pytest.raises(MessageError, match="not msgpack"):
            ask(place.client, KEYS.insert("a"), b"\x81")
    with pytest.raises(Unanswered):
        ask(place.client, KEYS.insert("a"), b"\x81")


@pytest.mark.usefixtures("stopped_clock")
def test_polls_count_as_steps(place: Place) -> None:
    place.serve_anew(quota=64)
    for _ in range(5):  # a second's come at once, and the one that is more is paid for
        assert not Ack.decode(ask(place.client, KEYS.insert("a"), b"")).throttle
    with pytest.raises(Unanswered):
        ask(place.client, KEYS.insert("a"), b"")


@pytest.mark.usefixtures("stopped_clock")
def test_recorded_games_have_no_measure_until_the_learner_trains(place: Place) -> None:
    """Nothing keeps an actor from their name where certificates do not tell actors apart."""
    place.serve_anew(quota=1e-9)
    rng, given = np.random.default_rng(0), Actor(DEMONSTRATIONS, 4)
    # An earlier learner, that was stopped before it drew, may have published its weights.
    place.client.publisher(KEYS.weights).publish(b"weights", b"0 test")
    for _ in until_late():
        if place.server._weights is not None:
            break
    for _ in range(2):
        assert insert(place.client, given.live([GOES_ON], rng)).status == "stored"
    assert place.buffer.sample(0, 0.0) is None
    assert insert(place.client, given.live([GOES_ON], rng)).status == "stored"
    with pytest.raises(Unanswered):
        insert(place.client, given.live([GOES_ON], rng))


@pytest.mark.usefixtures("stopped_clock")
def test_who_invents_names_holds_up_nobody_at_work_and_is_told_of_once(
    place: Place, caplog: pytest.LogCaptureFixture
) -> None:
    place.serve_anew()
    rng, worker = np.random.default_rng(0), Actor("worker", 4)
    assert insert(place.client, worker.live([GOES_ON], rng)).status == "stored"
    for number in range(2 * int(NEW_NAMES_PER_SECOND)):  # a second's of them may come at once
        with suppress(Unanswered, MessageError):
            ask(place.client, KEYS.insert(f"invented-{number}"), b"x")
    assert place.buffer.over_quota > NEW_NAMES_PER_SECOND / 2
    assert insert(place.client, worker.live([GOES_ON], rng)).status == "stored"
    crowd = [each for each in caplog.messages if "new actors" in each]
    assert crowd == ["more new actors come than are admitted at once: the rest has to wait"]


def test_of_another_run_neither_chunks_nor_weights_nor_learners_are_taken(
    place: Place, caplog: pytest.LogCaptureFixture
) -> None:
    """A learner may be begun anew under the same name, at the same address, with another game."""
    actor, rng = Actor("a", 4, run_id="other"), np.random.default_rng(0)
    ack = insert(place.client, actor.live([GOES_ON], rng))
    assert (ack.status, ack.run_id, ack.agent_steps) == ("refused", RUN, 0)
    assert (place.buffer.progress(0).refused, place.buffer.progress(0).accepted) == (1, 0)
    publisher = place.client.publisher(KEYS.weights)
    publisher.publish(b"weights", b"7 other")
    publisher.publish(b"weights", b"6 test")
    for _ in until_late():
        if place.buffer.weights_version == 6:
            break
    assert caplog.messages == [
        "a chunk of a was refused: it is of another run",
        "weights of 7 bytes were passed over: weights of another run than test",
    ]
    learner = RemoteReplay(place.client, RunKeys(RUN, "other"), make_config())
    with pytest.raises(InputError, match="serves another run under this name now"):
        learner.progress(0)


def test_junk_is_answered_and_counted_and_the_server_goes_on(place: Place) -> None:
    place.serve_anew(quota=1e9)
    dice = random.Random(0)
    actor = Actor("a", 4)
    good = actor.live([GOES_ON, TERMINATES], np.random.default_rng(0)).encode()
    junk = [dice.randbytes(dice.randrange(1, 300)) for _ in range(30)]
    junk += [good[: dice.randrange(1, len(good))] for _ in range(30)]
    for _ in range(30):  # the head of the message, where its structure is
        spoiled = bytearray(good)
        spoiled[dice.randrange(60)] ^= 1 << dice.randrange(8)
        junk.append(bytes(spoiled))
    refused = 0
    for message in junk:
        try:
            Ack.decode(ask(place.client, KEYS.insert("a"), message))
        except MessageError:
            refused += 1
    assert refused > 60
    assert place.buffer.progress(0).refused == refused
    for key in (KEYS.sample, KEYS.held_out, KEYS.progress):
        for message in (b"", b"\x81", good, pack({}), pack({"count": -1, "drawn": 2**63})):
            with pytest.raises(MessageError):
                ask(place.client, key, message)
    after = Actor("b", 4).live([GOES_ON] * 20, np.random.default_rng(0))
    assert insert(place.client, after).status == "stored"


def test_a_poll_waits_for_the_learner_and_holds_up_no_insert(place: Place) -> None:
    actor, rng = Actor("a", 4), np.random.default_rng(0)
    assert insert(place.client, actor.live([GOES_ON] * 100, rng)).throttle
    key = KEYS.insert("a")
    assert Ack.decode(ask(place.client, key, b"")).throttle  # after its second
    found: list[Ack] = []

    def poll(name: str) -> None:
        found.append(Ack.decode(ask(place.client, KEYS.insert(name), b"")))

    held = [threading.Thread(target=poll, args=name) for name in "abc"]
    for thread in held:
        thread.start()
    assert insert(place.client, Actor("d", 4).live([GOES_ON], rng)).status == "stored"
    assert place.remote.sample(10_000, 0.0) is None  # nothing to draw, but it tells its count
    for thread in held:
        thread.join(PATIENCE)
    assert [ack.status for ack in found] == ["poll"] * 3
    for _ in until_late():  # draws have a thread of their own
        ack = Ack.decode(ask(place.client, key, b""))
        if not ack.throttle:
            break
    assert not ack.throttle


def test_who_polls_again_before_its_answer_has_both(place: Place) -> None:
    chunk = Actor("a", 4).live([GOES_ON] * 100, np.random.default_rng(0))
    assert insert(place.client, chunk).throttle
    polls = place.client.requester(KEYS.insert("a"), PATIENCE)
    asked = [polls.request(b"") for _ in range(2)]
    assert all(Ack.decode(each.result().payload).throttle for each in asked)


def test_an_actor_that_ignores_the_throttle_takes_nobodys_turn(
    place: Place, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Chunks have 8 steps here and windows two chunks; at 84 steps all actors are throttled."""
    monkeypatch.setattr("replay.turns.INSISTENCE", 1)
    rng, flooder, honest = np.random.default_rng(0), Actor("flooder", 4), Actor("honest", 4)
    assert insert(place.client, honest.live([GOES_ON] * 8, rng)).status == "stored"
    assert not insert(place.client, flooder.live([GOES_ON] * 72, rng)).throttle  # still open
    late = flooder.live([GOES_ON] * 8, rng)
    assert insert(place.client, late).throttle
    stored = {"flooder": 0, "honest": 0}
    waiting = [flooder.live([GOES_ON] * 8, rng) for _ in range(4)]

    def flood() -> None:
        """Sends the same chunk again and again, until it is refused."""
        with suppress(Unanswered):
            while waiting:
                assert insert(place.client, waiting[0]).status == "stored"
                waiting.pop(0)
                stored["flooder"] += 1

    drawn = 0
    flood()
    assert stored["flooder"] == 0  # a window ahead
    for _ in range(4):  # each time the limiter opens, and the flooder is the first
        while place.buffer.progress(0).throttle:
            drawn += 16
            place.buffer.sample(drawn, 0.0)
        flood()
        assert not Ack.decode(ask(place.client, KEYS.insert("honest"), b"")).throttle
        assert insert(place.client, honest.live([GOES_ON] * 8, rng)).status == "stored"
        stored["honest"] += 1
        while not place.buffer.progress(0).throttle:  # a third one closes it, if need be
            insert(place.client, Actor("third", 4).live([GOES_ON] * 8, rng))
    assert stored["honest"] == 4
    assert 1 <= stored["flooder"] <= 4
    assert insert(place.client, late).status == "duplicate"
    assert place.buffer.over_quota > 0
    told = "flooder keeps sending although it is throttled: the rest has to wait"
    assert told in caplog.messages


def test_actors_that_leave_hand_in_their_last_chunks_to_a_learner_that_draws_no_more(
    place: Place,
) -> None:
    actor, rng = Actor("a", 4), np.random.default_rng(0)
    assert insert(place.client, actor.live([GOES_ON] * 100, rng)).throttle
    last = actor.live([GOES_ON] * 3, rng)
    with pytest.raises(Unanswered):
        insert(place.client, last)
    place.remote.close()  # as at a stop
    place.remote.drain()
    assert insert(place.client, last).status == "stored"
    assert insert(place.client, actor.live([GOES_ON] * 8, rng)).throttle  # who stays has to wait
    place.buffer.sample(0, 0.0)  # the learner goes on
    with pytest.raises(Unanswered):
        insert(place.client, actor.live([GOES_ON] * 8, rng))


def test_what_is_refused_for_a_while_is_not_even_read(place: Place) -> None:
    actor = Actor("a", 4)
    assert insert(place.client, actor.live([GOES_ON] * 100, np.random.default_rng(0))).throttle
    unread = create_autospec(Request, instance=True)
    unread.key, unread.size = KEYS.insert("a"), 60_000
    read = PropertyMock()
    type(unread).payload = read
    assert place.server._insert(unread) is None
    unread.drop.assert_called_once_with()
    read.assert_not_called()


def test_the_newest_weights_wait_for_late_joiners(place: Place) -> None:
    with pytest.raises(MessageError, match="no weights yet"):
        ask(place.client, KEYS.latest_weights, b"")
    publisher = place.client.publisher(KEYS.weights)
    actor, rng = Actor("a", 4), np.random.default_rng(0)
    publisher.publish(b"unversioned")
    publisher.publish(b"no counter holds it", b"9" * 20)  # once the end of the thread that read
    publisher.publish(b"odd", b"-1")
    for version in (50, 100):
        publisher.publish(b"weights %d" % version, b"%d test" % version)
    for _ in until_late():
        ack = insert(place.client, actor.live([GOES_ON], rng))
        if ack.weights_version == 100:
            break
    assert ack.weights_version == 100
    requester = place.client.requester(KEYS.latest_weights, PATIENCE)
    answer = requester.request(b"").result()
    assert answer == Envelope(b"weights 100", b"100 test", KEYS.latest_weights)


def test_a_learner_waits_for_a_server_that_is_away(place: Place) -> None:
    insert(place.client, Actor("a", 4).live([GOES_ON] * 30, np.random.default_rng(0)))
    place.server.close()
    assert place.remote.sample(0, 0.3) is None
    place.remote.update_priorities(np.arange(2), np.ones(2, np.float32))
    found: list[int] = []
    asking = threading.Thread(target=lambda: found.append(place.remote.progress(0).accepted))
    asking.start()
    place.server = ReplayServer(place.hub, place.buffer, make_config(), RUN)
    asking.join(PATIENCE)
    assert found == [1]
    assert place.remote.sample(0, PATIENCE) is not None


def test_asking_ahead_gives_no_batch_too_many_and_none_too_few(place: Place) -> None:
    actor, rng = Actor("a", 4), np.random.default_rng(0)
    insert(place.client, actor.live([GOES_ON] * 60, rng))
    batches = 0
    while place.buffer.sample(16 * batches, 0.0) is not None:
        batches += 1
    assert 10 < batches < 1_000
    for number in range(batches):
        assert place.remote.sample(16 * number, PATIENCE) is not None
    assert place.remote.sample(16 * batches, 0.5) is None


def test_a_batch_is_no_older_than_those_asked_for_ahead(place: Place) -> None:
    insert(place.client, Actor("a", 4).live([GOES_ON] * 60, np.random.default_rng(0)))
    for _ in range(3):
        assert place.remote.sample(0, PATIENCE) is not None
    place.buffer.update_priorities(np.arange(57), np.eye(57, dtype=np.float32)[7] * 1e9)
    found = [place.remote.sample(0, PATIENCE) for _ in range(AHEAD + 3)]
    for batch in found[AHEAD:]:
        assert batch is not None
        assert set(batch.ids.tolist()) == {7}


def test_no_number_is_told_that_is_not_yet_true_while_nothing_is_to_be_had(place: Place) -> None:
    """Or held actors would be let go by batches that the learner has not had."""
    place.server.close()
    asked = PendingRequests(place.client, KEYS.sample)
    told = []
    waiting = threading.Thread(target=place.remote.sample, args=(32, 10 * PATIENCE))
    waiting.start()
    for _ in range(4):
        request = asked.next()
        told.append(SampleRequest.decode(request.payload).drawn)
        request.reply(NO_BATCH)
    place.remote.close()
    waiting.join(PATIENCE)
    asked.close()
    assert told == [32] * 4


def test_a_learner_is_told_that_the_sampler_fails(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    insert(place.client, Actor("a", 4).live([GOES_ON] * 24, np.random.default_rng(0)))
    assert place.remote.progress(0).failed == ""
    monkeypatch.setattr(place.buffer._store.sampler._sampler, "draw", lambda *_: 1 / 0)
    assert place.remote.sample(0, 0.0) is None
    for _ in until_late():  # the draw goes its own way
        if told := place.remote.progress(0).failed:
            break
    assert told.startswith("the sampler 'prioritised' fails (ZeroDivisionError(")


def test_what_is_stored_is_made_durable_also_after_a_stop(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[bool] = []
    monkeypatch.setattr(place.buffer, "sync", lambda: synced.append(True))
    place.remote.close()
    place.remote.sync()
    assert synced == [True]


def test_a_disk_that_does_not_keep_the_steps_is_no_replay_that_is_away(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail() -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(place.buffer, "sync", fail)
    with pytest.raises(
        InputError, match=r"replay's disk does not keep its steps \(Input/output er"
    ):
        place.remote.sync()
    place.server.close()
    place.remote.close()
    place.remote.sync()  # nobody answers, which the interface allows


class Slow:
    """A replay's client that has asked a server which takes its time at ``key``."""

    def __init__(self, place: Place, monkeypatch: pytest.MonkeyPatch, key: str) -> None:
        monkeypatch.setattr("replay.client.DEADLINE", 0.1)
        monkeypatch.setattr("replay.client.LONG_DEADLINE", 10 * PATIENCE)
        self.remote = RemoteReplay(place.client, KEYS, make_config())
        place.server.close()
        self.asked = PendingRequests(place.client, key)
        self._other = place.client.requester(key, 0.1)

    def begin(self, ask: Callable[[], object]) -> tuple[threading.Thread, Request]:
        """Lets ``ask`` wait for an answer for longer than others do; returns its request."""
        thread = threading.Thread(target=ask, daemon=True)
        thread.start()
        request = self.asked.next()
        with pytest.raises(Unanswered):  # who asked later gives up
            self._other.request(b"").result()
        self.asked.next().drop()
        assert thread.is_alive()
        return thread, request


def test_tens_of_megabytes_have_more_time_than_other_answers(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = Slow(place, monkeypatch, KEYS.held_out)
    found: list[int] = []
    asking, request = slow.begin(lambda: found.append(len(slow.remote.held_out(1)[0])))
    request.reply(
        HeldOutStates(np.zeros((1, 4, 84, 84), np.uint8), np.zeros((1, 0), np.float32)).encode()
    )
    asking.join(PATIENCE)
    again = list(slow.asked.waiting())
    slow.remote.close()
    slow.asked.close()
    assert found == [1]
    assert not again


def test_a_slow_disk_has_more_time_than_other_answers_until_a_stop(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = Slow(place, monkeypatch, KEYS.progress)
    syncing, request = slow.begin(slow.remote.sync)
    assert ProgressRequest.decode(request.payload).durable
    request.reply(b"")
    syncing.join(PATIENCE)
    assert not syncing.is_alive()
    syncing, request = slow.begin(slow.remote.sync)
    slow.remote.close()
    syncing.join(PATIENCE)
    assert not syncing.is_alive()
    request.drop()
    slow.asked.close()


def test_the_next_request_tells_the_newest_priorities_in_order(place: Place) -> None:
    place.server.close()
    heard = PendingRequests(place.client, KEYS.sample)
    for _ in until_late():
        place.remote.sample(0, 0.1)
        if known := list(heard.waiting()):
            break
    for request in known:
        request.reply(NO_BATCH)
    place.remote.sample(0, 0.0)  # takes the answer
    for number in range(MAX_PRIORITY_UPDATES + 5):
        place.remote.update_priorities(np.array([number, 7]), np.array([number, 0.5], np.float32))
    told = []
    for _ in range(2):
        assert place.remote.sample(0, 0.1) is None
        request = heard.next()
        asked = SampleRequest.decode(request.payload)
        told.append(list(zip(asked.ids.tolist(), asked.priorities.tolist(), strict=True)))
        request.reply(NO_BATCH)
        place.remote.sample(0, 0.0)  # takes the answer
    heard.close()
    newest = range(5, MAX_PRIORITY_UPDATES + 5)
    assert told == [[pair for number in newest for pair in ((number, number), (7, 0.5))], []]


def test_the_last_priorities_are_told_at_the_end(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They may be of steps from which nothing can be learned. They draw nothing, so actors still
    wait for the learner."""
    insert(place.client, Actor("a", 4).live([GOES_ON] * 100, np.random.default_rng(0)))
    assert place.buffer.progress().throttle
    drawn = Mock(return_value=None)
    monkeypatch.setattr(place.buffer, "sample_shared", drawn)
    place.remote.update_priorities(np.arange(1), np.full(1, np.nan, np.float32))
    place.remote.close()
    for _ in until_late():
        if not place.buffer._store.sampler.contains(np.arange(1)).any():
            break
    assert not place.buffer._store.sampler.contains(np.arange(1)).any()
    # One client's requests are answered in turn, so the one before has been by then.
    nothing = SampleRequest(None, 0.0, np.zeros(0, np.int64), np.zeros(0, np.float32))
    with closing(place.client.requester(KEYS.sample, PATIENCE)) as requester:
        assert requester.request(nothing.encode()).result().payload == NO_BATCH
    assert not drawn.called
    assert place.buffer.progress().throttle


def test_priorities_may_be_taken_by_two_threads_at_once(place: Place) -> None:
    class Emptied(deque[Any]):
        """Emptied by another thread whenever somebody has looked at it."""

        def __bool__(self) -> bool:
            return True

    place.remote._updates = Emptied()
    ids, priorities = place.remote._take_updates()
    assert (len(ids), len(priorities)) == (0, 0)


def test_of_many_priorities_the_newest_are_told(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("replay.client.MAX_PRIORITIES", 3)
    for ids in (np.arange(2), np.arange(2, 5)):
        place.remote.update_priorities(ids, ids.astype(np.float32))
    ids, priorities = place.remote._take_updates()
    assert (ids.tolist(), priorities.tolist()) == ([2, 3, 4], [2.0, 3.0, 4.0])


def test_a_request_with_too_many_priorities_is_refused() -> None:
    many = MAX_PRIORITIES + 1
    asked = SampleRequest(0, 0.0, np.zeros(many, np.int64), np.zeros(many, np.float32))
    with pytest.raises(MessageError, match="B is 65537 where 0 to 65536 are allowed"):
        SampleRequest.decode(asked.encode())


def test_refused_priorities_are_told_at_the_next_draw(place: Place) -> None:
    place.remote.update_priorities(np.arange(1), -np.ones(1, np.float32))
    with pytest.raises(InputError, match=r"not be negative\): start both from the same version"):
        place.remote.sample(0, PATIENCE)
    assert place.remote.progress(0).refused == 0  # it was no chunk


def test_batches_under_way_to_a_server_that_dies_are_asked_for_again(place: Place) -> None:
    insert(place.client, Actor("a", 4).live([GOES_ON] * 30, np.random.default_rng(0)))
    for _ in range(3):
        assert place.remote.sample(0, PATIENCE) is not None
    place.server.close()
    while place.remote.sample(0, 0.3) is not None:
        pass
    place.server = ReplayServer(place.hub, place.buffer, make_config(), RUN)
    for _ in range(2 * AHEAD):
        assert place.remote.sample(0, PATIENCE) is not None


def test_a_learner_that_stops_waits_no_longer(place: Place) -> None:
    place.server.close()
    failures: list[BaseException] = []

    def wait() -> None:
        try:
            place.remote.progress(0)
        except InputError as error:
            failures.append(error)

    asking = threading.Thread(target=wait)
    asking.start()
    place.remote.close()
    asking.join(PATIENCE)
    assert "did not answer" in str(failures[0])
    assert place.remote.sample(0, 10 * PATIENCE) is None


def test_a_learner_says_once_that_it_waits_and_once_that_it_goes_on(
    place: Place, caplog: pytest.LogCaptureFixture
) -> None:
    """For hours otherwise, in silence: who waits looks at no watchdog."""
    place.server.close()
    found: list[int] = []
    waiting = threading.Thread(target=lambda: found.append(place.remote.progress(0).accepted))
    waiting.start()
    for _ in until_late():
        if "does not answer" in caplog.text:
            break
    waiting.join(0.5)  # it asks some more times
    place.server = ReplayServer(place.hub, place.buffer, make_config(), RUN)
    waiting.join(PATIENCE)
    assert found == [0]
    assert [record.message for record in caplog.records] == [
        "the replay does not answer: training waits for it",
        "the replay answers again: training continues",
    ]


def test_a_learner_that_has_stopped_does_not_say_that_it_waits(
    place: Place, caplog: pytest.LogCaptureFixture
) -> None:
    place.remote.close()
    assert place.remote.progress(0).accepted == 0  # the last figures
    place.server.close()
    with pytest.raises(InputError, match="did not answer before this process stopped"):
        place.remote.progress(0)
    assert not caplog.messages


def test_a_draw_waits_no_longer_than_the_server_lets_it(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python itself waits for no more than 292 years, and raises if it is asked to."""
    monkeypatch.setattr("replay.server.LONGEST_WAIT", 0.05)
    endless = SampleRequest(0, 1e308, np.zeros(0, np.int64), np.zeros(0, np.float32))
    assert ask(place.client, KEYS.sample, endless.encode()) == NO_BATCH


def test_weights_that_no_actor_would_take_are_passed_over(
    place: Place, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("replay.server.MAX_MESSAGE_BYTES", 28)
    voice = place.hub.publisher(KEYS.weights)
    voice.publish(b"x" * 29, b"8 test")
    voice.publish(b"x" * 28, b"7 test")
    for _ in until_late():
        if place.buffer.weights_version == 7:
            break
    assert ask(place.client, KEYS.latest_weights, b"") == b"x" * 28
    assert "weights of 29 bytes were passed over" in caplog.text
