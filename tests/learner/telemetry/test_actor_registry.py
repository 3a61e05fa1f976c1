"""Who lives, who left, who was lost."""

import json
import math
from dataclasses import asdict, replace
from typing import Any

import pytest

import learner.telemetry.actor_registry as module
from common.metrics import METRICS
from common.protocol.actor_stats import ActorStats
from common.transport.interface import Envelope, Transport
from learner.telemetry.actor_registry import ActorRegistry
from replay.chunk_statistics import ChunkStatistics
from tests.learner.conftest import KEYS
from tests.patience import wait_until

STATS = ActorStats(
    name="a1", role="actor", incarnation=7, leaving=False, steps=640, steps_per_second=100.0,
    epsilon=0.5, weights_version=50, made=10, acked=8, retried=2, refused=0, throttled_share=0.25,
    valid=480, matched=320, decisions=700, missed_deadlines=5, late_frames=6,
    waits_given_up=7, key_times=(1,) * 60 + (5,) * 60,
)  # fmt: skip


def chunks(registry: ActorRegistry) -> tuple[Any, ...]:
    """Made, sent again, and stored in excess."""
    values, _ = registry.totals()
    assert values.keys() <= METRICS.keys()
    return tuple(values[f"stream/chunks_{name}"] for name in ("made", "retried", "excess"))


def credit(registry: ActorRegistry, count: int, incarnation: int = 7) -> None:
    """The replay stores so many chunks of a process."""
    for index in range(count):
        registry.accepted(
            ChunkStatistics(index, 64 * index, 64, "a1", 0.5, 50, 0, 64, 64, (), incarnation)
        )


def test_an_actor_from_its_arrival_to_its_leave(
    hub: Transport, client: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_LAST_WORDS", 0.2)
    registry = ActorRegistry(hub, KEYS)
    notes: list[str] = []
    token = client.announce(KEYS.live("actor", "a1"))
    wait_until(lambda: registry.alive("actor") == {"a1"}, "the actor is present")
    assert registry.alive("evaluator") == set()
    client.publisher(KEYS.stats("actor", "a1")).publish(STATS.encode())
    wait_until(lambda: chunks(registry) == (10, 2, 0), "the heartbeat is counted")
    (actor,) = registry.actors()
    assert (actor.alive, actor.stats) == (True, STATS)
    assert (actor.stats.valid_share, actor.stats.match_share) == (0.75, 0.5)

    client.publisher(KEYS.stats("actor", "a1")).publish(
        replace(STATS, leaving=True, made=11).encode()
    )
    wait_until(lambda: chunks(registry) == (11, 2, 0), "the heartbeat is counted")
    token.close()

    def told_that_it_left() -> bool:
        notes.extend(registry.take_notes())
        return "a1 left" in notes

    wait_until(told_that_it_left, "its end is noted")
    assert notes == ["a1 joined", "a1 left"]
    (actor,) = registry.actors()
    assert not actor.alive


def test_one_that_goes_without_a_word_was_lost(
    hub: Transport, client: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_LAST_WORDS", math.inf)
    registry = ActorRegistry(hub, KEYS)
    token = client.announce(KEYS.live("actor", "a1"))
    wait_until(lambda: registry.alive("actor") == {"a1"}, "the actor is present")
    client.publisher(KEYS.stats("actor", "a1")).publish(STATS.encode())
    wait_until(lambda: chunks(registry) == (10, 2, 0), "the heartbeat is counted")
    token.close()
    wait_until(lambda: registry.alive("actor") == set(), "the actor has gone")
    assert registry.take_notes() == ["a1 joined"]
    assert registry.actors()[0].alive  # its last words may still come
    monkeypatch.setattr(module, "_LAST_WORDS", 0.0)
    assert registry.take_notes() == ["a1 was lost"]
    assert not registry.actors()[0].alive


def test_heartbeats_of_another_run_are_not_counted(hub: Transport, client: Transport) -> None:
    registry = ActorRegistry(hub, KEYS)
    heartbeats = client.publisher(KEYS.stats("actor", "a1"))
    heartbeats.publish(replace(STATS, made=99, run_id="another").encode())
    heartbeats.publish(replace(STATS, incarnation=8).encode())
    wait_until(lambda: chunks(registry) == (10, 2, 0), "the heartbeat is counted")


def test_counts_add_up_over_restarts_of_actor_and_learner(
    hub: Transport, client: Transport
) -> None:
    registry = ActorRegistry(hub, KEYS)
    client.publisher(KEYS.stats("actor", "a1")).publish(STATS.encode())
    client.publisher(KEYS.stats("actor", "a1")).publish(
        replace(STATS, incarnation=8, made=5).encode()
    )
    wait_until(lambda: chunks(registry) == (15, 4, 0), "the heartbeat is counted")
    again = ActorRegistry(client, KEYS)
    again.restore(json.loads(json.dumps(registry.state())))
    assert chunks(again) == (15, 4, 0)
    values, key_times = again.totals()
    assert key_times == registry.totals()[1] == (2,) * 60 + (10,) * 60
    assert [values[f"actors/{name}"] for name in ("steps", "elapsed", "missed_deadlines")] == [
        1_280,
        1_400,
        10,
    ]
    assert (values["actors/late_frames"], values["actors/waits_given_up"]) == (12, 14)
    assert values["actors/elapsed_per_step"] == 1_400 / 1_280
    # The new subscription may be unknown to the hub yet: heartbeats come again and again.
    beat = replace(STATS, incarnation=8, made=6).encode()
    voice = hub.publisher(KEYS.stats("actor", "a1"))

    def known_after_another() -> bool:
        voice.publish(beat)
        return chunks(again) == (16, 4, 0)

    wait_until(known_after_another, "a later heartbeat is counted")


def test_a_checkpoint_from_before_hands_were_timed_is_restored(hub: Transport) -> None:
    registry = ActorRegistry(hub, KEYS)
    assert registry.totals()[1] == ()
    told = asdict(STATS)
    del told["key_times"], told["valid"]
    told["valid_share"] = 0.75
    registry.restore([told, asdict(replace(STATS, incarnation=8))])
    assert chunks(registry) == (20, 4, 0)
    assert registry.totals()[1] == STATS.key_times


def test_noise_is_passed_over(hub: Transport, client: Transport) -> None:
    registry = ActorRegistry(hub, KEYS)
    client.publisher(KEYS.stats("actor", "a1")).publish(b"noise")
    client.publisher(KEYS.stats("actor", "somebody-else")).publish(
        replace(STATS, incarnation=8).encode()
    )
    client.publisher(KEYS.stats("actor", "a1")).publish(replace(STATS, made=3).encode())
    wait_until(lambda: chunks(registry) != (0, 0, 0), "the heartbeat is counted")
    assert chunks(registry) == (3, 2, 0)


def test_one_that_left_is_still_counted(
    hub: Transport, client: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "LEFT_SHOWN", 0.0)
    registry = ActorRegistry(hub, KEYS)
    token = client.announce(KEYS.live("actor", "a1"))
    client.publisher(KEYS.stats("actor", "a1")).publish(replace(STATS, leaving=True).encode())
    wait_until(lambda: chunks(registry) == (10, 2, 0), "the heartbeat is counted")
    wait_until(lambda: registry.alive("actor") == {"a1"}, "the actor is present")
    assert not registry.actors()[0].left
    token.close()
    wait_until(lambda: registry.alive("actor") == set(), "the actor has gone")
    (actor,) = registry.actors()
    assert (actor.left, actor.stats.made) == (True, 10)


class Told:
    """A registry whose processes speak by `say`, on a clock that the test turns."""

    def __init__(self, hub: Transport) -> None:
        self.now = 1_000.0
        self.registry = ActorRegistry(hub, KEYS, lambda: self.now)

    def say(self, seconds: float = 0.0, **counters: Any) -> None:
        self.now += seconds
        stats = replace(STATS, **counters)
        key = KEYS.stats(stats.role, stats.name)
        self.registry._on_stats(Envelope(stats.encode(), key=key))

    def totals(self) -> tuple[Any, ...]:
        """Those that must not change as processes are folded."""
        values, key_times = self.registry.totals()
        return *chunks(self.registry), values["actors/steps"], key_times


@pytest.fixture
def told(hub: Transport) -> Told:
    return Told(hub)


def test_a_process_that_was_killed_made_what_came_from_it(told: Told, hub: Transport) -> None:
    told.say(made=10, refused=1)
    credit(told.registry, 12)
    assert chunks(told.registry) == (13, 2, 0)
    credit(told.registry, 3, incarnation=99)  # it was never heard at all
    assert chunks(told.registry) == (16, 2, 0)
    state = json.loads(json.dumps(told.registry.state()))
    again = ActorRegistry(hub, KEYS)
    again.restore(state)
    assert chunks(again) == (16, 2, 0)


def test_chunks_that_are_stored_twice_are_told_once_their_actor_said_goodbye(told: Told) -> None:
    told.say(made=10, acked=10)
    credit(told.registry, 20)
    told.say(made=10, acked=10, leaving=True)
    assert chunks(told.registry) == (10, 2, 10)
    # What another process lost does not hide it.
    told.say(incarnation=8, made=30)
    assert chunks(told.registry) == (40, 4, 10)


def test_chunks_that_are_stored_twice_are_told_while_their_actor_lives(told: Told) -> None:
    told.say(made=10)
    credit(told.registry, 20)
    for _ in range(3):  # late heartbeats, sent before ten more were made
        told.say(seconds=1.0, made=10)
    assert chunks(told.registry)[2] == 0
    for _ in range(2):
        told.say(seconds=6.0, made=12)
    assert chunks(told.registry)[2] == 8
    told.say(seconds=6.0, made=20)
    assert chunks(told.registry)[2] == 0


def test_names_are_bounded_and_totals_are_not_lost(
    told: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_MAX_GONE", 3)
    for number in range(10):
        told.say(name=f"a{number}", incarnation=100 + number, made=number, leaving=number % 2 == 0)
    told.say(name="a9", incarnation=200)  # replaces the other of its name
    credit(told.registry, 4, incarnation=101)
    before = told.totals()
    assert before[0] == sum(range(10)) + 3 + 10
    assert len(told.registry.state()["processes"]) == 11
    told.now += 100.0
    assert told.totals() == before
    state = json.loads(json.dumps(told.registry.state()))
    assert [each["name"] for each in state["processes"]] == ["a7", "a8", "a9"]
    # Words and chunks of those that are in the totals do not count them again.
    told.say(name="a1", incarnation=101, made=4)
    assert told.totals() == before
    credit(told.registry, 1, incarnation=101)
    assert chunks(told.registry)[0] == before[0] + 1
    credit(told.registry, 3, incarnation=102)  # two that it told of, and one more
    assert chunks(told.registry)[2] == 1


@pytest.mark.parametrize("leaving", [False, True])
def test_chunks_that_come_after_their_process_was_folded_are_counted_once(
    told: Told, hub: Transport, monkeypatch: pytest.MonkeyPatch, leaving: bool
) -> None:
    monkeypatch.setattr(module, "_MAX_GONE", 0)
    told.say(made=10, refused=1, leaving=leaving)
    credit(told.registry, 7)
    told.now += 100.0
    assert chunks(told.registry) == (10, 2, 0)
    assert told.registry.state()["processes"] == []
    credit(told.registry, 1)
    again = Told(hub)
    again.registry.restore(json.loads(json.dumps(told.registry.state())))
    credit(again.registry, 1)
    assert chunks(again.registry) == (10, 2, 0)
    credit(again.registry, 1)
    assert chunks(again.registry) == ((10, 2, 1) if leaving else (11, 2, 0))


def test_what_an_earlier_checkpoint_kept_of_folded_processes_is_read(told: Told) -> None:
    told.registry.restore({"processes": [], "gone": [], "excess": 0, "folded": [[7, True]]})
    credit(told.registry, 1)
    assert chunks(told.registry) == (0, 0, 1)


def test_totals_of_folded_processes_survive_a_checkpoint(
    told: Told, hub: Transport, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_MAX_GONE", 1)
    for number in range(5):
        told.say(name=f"a{number}", incarnation=100 + number, leaving=True)
    credit(told.registry, 12, incarnation=101)
    told.now += 100.0
    before = told.totals()
    assert before[:3] == (50, 10, 2)
    assert len(told.registry.state()["folded"]) == 4
    again = Told(hub)
    again.say(name="a1", incarnation=101)  # one that was away for a while
    again.registry.restore(json.loads(json.dumps(told.registry.state())))
    assert again.totals() == before
    again.say(name="a1", incarnation=101)
    assert again.totals() == before


def test_what_is_remembered_of_folded_processes_is_bounded(
    told: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_MAX_GONE", 0)
    monkeypatch.setattr(module, "_MAX_KNOWN", 2)
    for number in range(5):
        told.say(name=f"a{number}", incarnation=100 + number)
        told.now += 100.0
        assert chunks(told.registry) == (10 * number + 10, 2 * number + 2, 0)
    state = told.registry.state()
    assert [incarnation for incarnation, *_ in state["folded"]] == [103, 104]
    assert (state["processes"], len(state["gone"])) == ([], 1)


def test_a_process_started_again_is_not_gone_before_its_first_heartbeat(told: Told) -> None:
    told.say(incarnation=7, made=10)
    told.registry._on_presence(KEYS.live("actor", "a1"), True)
    told.now += 1_000.0
    credit(told.registry, 1, incarnation=8)  # a quick one's first chunk; its name is the old one's
    assert chunks(told.registry)[0] == 11
    told.say(incarnation=8, made=5, refused=2)
    assert [actor.stats.incarnation for actor in told.registry.actors()] == [8]
    assert told.registry.totals()[0]["actors/refused"] == 2
    assert chunks(told.registry)[0] == 15


def test_one_that_is_heard_before_the_checkpoint_is_restored_keeps_its_chunks(
    told: Told, hub: Transport
) -> None:
    told.say(made=10)
    credit(told.registry, 20)
    again = Told(hub)
    again.say(made=12, seconds=1.0)
    again.registry.restore(json.loads(json.dumps(told.registry.state())))
    assert again.registry.actors() == ()
    assert [each["made"] for each in again.registry.state()["processes"]] == [12]
    assert chunks(again.registry)[0] == 20


def test_a_chunk_in_the_name_of_a_folded_evaluator_ends_nothing(
    told: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_MAX_GONE", 0)
    told.say(name="e", role="evaluator", made=0)
    told.now += 100.0
    assert chunks(told.registry)[0] == 0
    credit(told.registry, 1)
    assert chunks(told.registry)[0] == 1


def test_one_that_is_present_but_was_never_heard_is_not_replaced(told: Told) -> None:
    told.registry._on_presence(KEYS.live("actor", "a1"), True)
    credit(told.registry, 3)
    told.now += 1_000.0
    assert chunks(told.registry)[0] == 3
    assert [each["incarnation"] for each in told.registry.state()["processes"]] == [7]


def test_one_that_is_back_at_once_was_not_lost(told: Told) -> None:
    key = KEYS.live("actor", "a1")
    for present in (True, False, True):
        told.registry._on_presence(key, present)
    told.now += 100.0
    assert told.registry.take_notes() == ["a1 joined"]


def test_one_that_is_present_is_kept_however_long_it_is_silent(
    told: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_MAX_GONE", 0)
    told.registry._on_presence(KEYS.live("actor", "a1"), True)
    told.say()
    told.now += 1_000.0
    assert chunks(told.registry)[0] == 10
    told.say(made=12)
    assert chunks(told.registry)[0] == 12
    assert [actor.stats.made for actor in told.registry.actors()] == [12]


def test_a_flood_of_starts_neither_grows_the_checkpoint_nor_hides_the_living(
    told: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_MAX_KNOWN", 8)
    told.registry._on_presence(KEYS.live("actor", "good"), True)
    told.say(name="good", incarnation=1)
    for number in range(1_000):
        told.say(name="bad", incarnation=100 + number)
    state = told.registry.state()
    assert len(state["processes"]) == len(state["folded"]) == 8
    assert "good" in {each["name"] for each in state["processes"]}
    assert told.totals()[:3] == (10_010, 2_002, 0)


def test_only_names_are_known_and_only_so_many(told: Told, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MAX_KNOWN", 8)
    told.say(name="a b")
    told.registry._on_presence(KEYS.live("actor", "x" * 65), True)
    assert told.registry.actors() == ()
    for number in range(1_000):
        told.registry._on_presence(KEYS.live("actor", f"bad{number}"), True)
        told.registry._on_presence(KEYS.live("actor", f"bad{number}"), False)
    assert len(told.registry._names) == 8
    assert len(told.registry.take_notes()) == 8
    told.now += 100.0
    told.registry.totals()
    told.say(name="good")
    assert [actor.stats.name for actor in told.registry.actors()] == []
    told.registry._on_presence(KEYS.live("actor", "good"), True)
    assert [actor.stats.name for actor in told.registry.actors()] == ["good"]


def test_only_actors_and_evaluators_are_present(told: Told) -> None:
    told.registry._on_presence(KEYS.live("stranger", "a1"), True)
    assert (told.registry.take_notes(), told.registry.actors()) == ([], ())
    assert told.registry.alive("stranger") == set()


def test_two_processes_of_one_name_are_told_once(told: Told) -> None:
    told.say(incarnation=7)
    told.say(1.0, incarnation=8)
    told.say(1.0, incarnation=7)  # was on its way
    told.say(10.0, incarnation=8)
    told.say(1.0, incarnation=7, leaving=True)
    assert told.registry.take_notes() == []
    for incarnation in (8, 7, 8, 7):
        told.say(1.0, incarnation=incarnation)
    notes = told.registry.take_notes()
    assert [note.partition(",")[0] for note in notes] == ["two processes are called a1"]


def test_signs_of_life_are_tokens_and_heartbeats(told: Told) -> None:
    def silence() -> float:
        told.now += 3.0
        return told.registry.actors()[0].silent_for

    told.registry._on_presence(KEYS.live("actor", "a1"), True)
    assert silence() == 3.0
    told.say()
    assert silence() == 3.0
    told.registry._on_presence(KEYS.live("actor", "a1"), False)
    assert silence() == 3.0
    assert silence() == 6.0


@pytest.mark.parametrize(("heard", "leaving"), [(True, True), (True, False), (False, False)])
def test_one_that_left_is_shown_for_a_while_and_one_that_was_lost_for_longer(
    told: Told, heard: bool, leaving: bool
) -> None:
    """One that was never heard may have said good-bye as well: it is not shown as lost."""
    told.registry._on_presence(KEYS.live("actor", "a1"), True)
    if heard:
        told.say(leaving=leaving)
    told.registry._on_presence(KEYS.live("actor", "a1"), False)
    told.now += module.LEFT_SHOWN
    told.registry.take_notes()
    assert [actor.left for actor in told.registry.actors()] == [False]
    told.now += 0.5
    assert [actor.left for actor in told.registry.actors()] == [leaving or not heard]


def test_one_that_was_lost_stays_on_the_display_and_does_nothing_there(told: Told) -> None:
    told.registry._on_presence(KEYS.live("actor", "a1"), True)
    told.say(busy_cores=0.75)
    (stats,) = (actor.stats for actor in told.registry.actors())
    assert (stats.steps_per_second, stats.throttled_share, stats.busy_cores) == (100.0, 0.25, 0.75)
    told.registry._on_presence(KEYS.live("actor", "a1"), False)
    told.now += 1_000.0
    assert told.registry.take_notes() == ["a1 joined", "a1 was lost"]
    told.registry.totals()
    (actor,) = told.registry.actors()
    assert (actor.alive, actor.left) == (False, False)
    stats = actor.stats
    assert (stats.steps_per_second, stats.throttled_share, stats.busy_cores) == (0.0, 0.0, 0.0)
    assert (stats.steps, stats.made) == (640, 10)


def test_a_loss_is_noted_even_of_one_that_was_never_heard(told: Told) -> None:
    for present in (True, False):
        told.registry._on_presence(KEYS.live("actor", "a1"), present)
    told.registry.totals()  # drops names of which nothing is to be said any more
    told.now += 2.0
    assert told.registry.take_notes() == ["a1 joined", "a1 was lost"]


def test_the_last_words_of_a_process_that_was_replaced_may_take_a_minute(told: Told) -> None:
    told.say(incarnation=7, made=10)
    told.say(incarnation=8, made=5)
    told.now += 60.0
    assert chunks(told.registry)[0] == 15
    told.say(incarnation=7, made=12, leaving=True)
    assert chunks(told.registry)[0] == 17
    told.say(incarnation=8, made=5)
    told.now += 60.5
    assert chunks(told.registry)[0] == 17
    told.say(incarnation=7, made=99)
    assert chunks(told.registry)[0] == 17


def test_one_whose_chunks_still_come_has_not_gone(
    told: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_MAX_GONE", 0)
    told.say(made=10)
    told.now += 50.0
    credit(told.registry, 1)
    told.now += 50.0
    assert chunks(told.registry)[0] == 10
    told.say(made=12)
    assert chunks(told.registry)[0] == 12


def test_a_replaced_process_is_folded_although_its_name_is_present(told: Told) -> None:
    told.registry._on_presence(KEYS.live("actor", "a1"), True)
    told.say(incarnation=7)
    told.say(incarnation=8)
    told.now += 100.0
    state = told.registry.state()
    assert [each["incarnation"] for each in state["processes"]] == [8]
    assert [incarnation for incarnation, *_ in state["folded"]] == [7]


def test_the_oldest_are_folded_first(told: Told, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MAX_GONE", 1)
    for name, incarnation in (("b", 3), ("c", 1), ("a", 2)):
        told.say(1.0, name=name, incarnation=incarnation)
    told.now += 100.0
    assert [each["name"] for each in told.registry.state()["processes"]] == ["a"]


def test_chunks_that_were_stored_twice_stay_so_after_their_process_was_folded(
    told: Told, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_MAX_GONE", 0)
    told.say(made=10, leaving=True)
    credit(told.registry, 12)
    told.now += 100.0
    assert chunks(told.registry) == (10, 2, 2)
    credit(told.registry, 1)
    assert chunks(told.registry) == (10, 2, 3)


def test_chunks_that_came_just_before_a_heartbeat_may_be_newer_than_it(told: Told) -> None:
    told.say(made=10)
    told.now += 6.0
    credit(told.registry, 12)
    told.say(made=10)  # sent before the last two were made
    assert chunks(told.registry)[2] == 0


def test_a_chunk_without_a_process_is_nobodys(told: Told) -> None:
    """As of journals that were written before chunks had an incarnation."""
    credit(told.registry, 1, incarnation=0)
    assert chunks(told.registry) == (0, 0, 0)
    assert told.registry.state()["processes"] == []
