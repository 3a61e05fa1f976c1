"""Who lives, who left, who was lost."""

import json
import time
from collections.abc import Callable
from dataclasses import asdict, replace

import pytest

import learner.telemetry.actor_registry as module
from common.protocol.actor_stats import ActorStats
from common.transport.interface import Transport
from learner.telemetry.actor_registry import ActorRegistry
from learner.telemetry.status import TimeCounts
from tests.learner.conftest import KEYS

STATS = ActorStats(
    name="a1", role="actor", incarnation=7, leaving=False, steps=640, steps_per_second=100.0,
    epsilon=0.5, weights_version=50, made=10, acked=8, retried=2, refused=0, held_share=0.25,
    valid_share=0.75, match_share=0.5, decisions=700, missed_deadlines=5, late_frames=6,
    waits_given_up=7, key_times=(1,) * 60 + (5,) * 60,
)  # fmt: skip


def _until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_an_actor_from_its_arrival_to_its_leave(
    hub: Transport, client: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_LAST_WORDS", 0.2)
    roster = ActorRegistry(hub, KEYS)
    notes: list[str] = []
    token = client.announce(KEYS.live("actor", "a1"))
    _until(lambda: roster.alive("actor") == {"a1"})
    assert roster.alive("evaluator") == set()
    client.publisher(KEYS.stats("actor", "a1")).publish(STATS.encode())
    _until(lambda: roster.counts() == (10, 2))
    (actor,) = roster.actors()
    assert (actor.name, actor.alive, actor.steps, actor.made) == ("a1", True, 640, 10)
    assert (actor.decisions, actor.missed_deadlines) == (700, 5)
    assert (actor.late_frames, actor.waits_given_up) == (6, 7)
    assert (actor.held_share, actor.valid_share, actor.match_share) == (0.25, 0.75, 0.5)

    client.publisher(KEYS.stats("actor", "a1")).publish(
        replace(STATS, leaving=True, made=11).encode()
    )
    _until(lambda: roster.counts() == (11, 2))
    token.close()
    _until(lambda: bool(notes.extend(roster.take_notes()) or "a1 left" in notes))
    assert notes == ["a1 joined", "a1 left"]
    (actor,) = roster.actors()
    assert not actor.alive


def test_one_that_goes_without_a_word_was_lost(
    hub: Transport, client: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_LAST_WORDS", 0.2)
    roster = ActorRegistry(hub, KEYS)
    token = client.announce(KEYS.live("actor", "a1"))
    _until(lambda: roster.alive("actor") == {"a1"})
    client.publisher(KEYS.stats("actor", "a1")).publish(STATS.encode())
    _until(lambda: roster.counts() == (10, 2))
    token.close()
    notes: list[str] = []
    _until(lambda: bool(notes.extend(roster.take_notes()) or "a1 was lost" in notes))
    assert roster.alive("actor") == set()


def test_counts_add_up_over_restarts_of_actor_and_learner(
    hub: Transport, client: Transport
) -> None:
    roster = ActorRegistry(hub, KEYS)
    client.publisher(KEYS.stats("actor", "a1")).publish(STATS.encode())
    client.publisher(KEYS.stats("actor", "a1")).publish(
        replace(STATS, incarnation=8, made=5).encode()
    )
    _until(lambda: roster.counts() == (15, 4))
    again = ActorRegistry(client, KEYS)
    again.restore(json.loads(json.dumps(roster.state())))
    assert again.counts() == (15, 4)
    assert again.key_times() == roster.key_times() == (2,) * 60 + (10,) * 60
    assert again.time() == TimeCounts(
        steps=1_280, decisions=1_400, missed_deadlines=10, late_frames=12, waits_given_up=14
    )
    # The new subscription may be unknown to the hub yet: heartbeats come again and again.
    beat = replace(STATS, incarnation=8, made=6).encode()
    _until(
        lambda: hub.publisher(KEYS.stats("actor", "a1")).publish(beat) or again.counts() == (16, 4)
    )


def test_a_checkpoint_from_before_hands_were_timed_is_restored(
    hub: Transport, client: Transport
) -> None:
    roster = ActorRegistry(hub, KEYS)
    assert roster.key_times() == ()
    told = asdict(STATS)
    del told["key_times"]
    roster.restore([told, asdict(replace(STATS, incarnation=8))])
    assert roster.counts() == (20, 4)
    assert roster.key_times() == STATS.key_times


def test_noise_is_passed_over(hub: Transport, client: Transport) -> None:
    roster = ActorRegistry(hub, KEYS)
    client.publisher(KEYS.stats("actor", "a1")).publish(b"noise")
    client.publisher(KEYS.stats("actor", "somebody-else")).publish(STATS.encode())
    client.publisher(KEYS.stats("actor", "a1")).publish(replace(STATS, made=3).encode())
    _until(lambda: roster.counts() != (0, 0))
    assert roster.counts() == (3, 2)


def test_one_that_left_is_still_counted(
    hub: Transport, client: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "LEFT_SHOWN", 0.0)
    roster = ActorRegistry(hub, KEYS)
    token = client.announce(KEYS.live("actor", "a1"))
    client.publisher(KEYS.stats("actor", "a1")).publish(replace(STATS, leaving=True).encode())
    _until(lambda: roster.counts() == (10, 2) and roster.alive("actor") == {"a1"})
    assert not roster.actors()[0].left
    token.close()
    _until(lambda: roster.alive("actor") == set())
    (actor,) = roster.actors()
    assert (actor.left, actor.made) == (True, 10)
