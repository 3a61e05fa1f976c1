"""Single actors that do not see or touch, found among others that do."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import cycle, islice

import pytest

from common.protocol.run_keys import DEMONSTRATIONS
from common.run.config import RunConfig
from common.run.presets import PRESETS
from learner.faulty_actors import FaultyActors
from learner.phases import Phases
from learner.run_clock import RunClock
from learner.telemetry.health_checks import judge
from replay.chunk_statistics import ChunkStatistics

STEPS = 64
HEALTHY = {"valid": STEPS, "follows": STEPS, "matched": STEPS}


def chunk(index: int, actor: str, **shares: int) -> ChunkStatistics:
    return ChunkStatistics(
        index=index,
        agent_steps=(index + 1) * STEPS,
        steps=STEPS,
        actor=actor,
        epsilon=0.1,
        weights_version=0,
        staleness=0,
        games=(),
        **(HEALTHY | shares),
    )


def played(
    actors: FaultyActors, names: Iterable[str], faults: dict[str, dict[str, int]], first: int = 0
) -> None:
    for index, name in enumerate(names, first):
        actors.add(chunk(index, name, **faults.get(name, {})))


@pytest.mark.parametrize("share", ["valid", "follows", "matched"])
def test_one_faulty_robot_of_eight_ends_up_in_a_check_that_stops_the_run(share: str) -> None:
    config = PRESETS["robot"]
    phases = Phases(config, RunClock(lambda: 0.0))
    names = [f"actor-{number}" for number in range(8)]
    for index, name in enumerate(islice(cycle(names), 8 * 16)):
        phases.count(chunk(index, name, **({share: 4} if name == "actor-3" else {})))
    checks = {check.name: check for check in judge(phases.values(finishing=False), config)}
    # Its steps do not show in the mean of all, which is what the other checks judge.
    assert checks["keys as commanded"].passed
    assert "following frames" not in checks
    found = checks["faulty actors"]
    assert (found.value, found.passed, found.stops) == (1.0, False, True)
    assert found.why.endswith(": actor-3")


def test_robots_that_see_and_touch_are_not_listed() -> None:
    actors = FaultyActors(keys_can_follow=True)
    played(actors, islice(cycle("ab"), 100), {"a": {"valid": 32, "follows": 32, "matched": 32}})
    assert actors.values() == {"play/faulty_actors": 0, "play/faulty_actor_names": ""}
    assert "faulty actors" not in {check.name for check in judge(actors.values(), PRESETS["robot"])}


def test_an_actor_is_judged_after_eight_chunks_and_by_its_newest_sixteen() -> None:
    actors = FaultyActors(keys_can_follow=True)
    played(actors, 7 * "a", {"a": {"valid": 31}})
    assert actors.values()["play/faulty_actors"] == 0
    played(actors, "a", {"a": {"valid": 31}}, first=7)
    assert actors.values()["play/faulty_actors"] == 1
    played(actors, 8 * "a", {"a": {"valid": 33}}, first=8)  # half of all steps
    assert actors.values()["play/faulty_actors"] == 0
    played(actors, 9 * "a", {"a": {"valid": 0}}, first=16)  # the first eight do not count any more
    assert actors.values()["play/faulty_actors"] == 1
    played(actors, 9 * "a", {}, first=25)
    assert actors.values()["play/faulty_actors"] == 0


def test_hands_that_cannot_follow_in_time_are_not_judged() -> None:
    for can, count in ((True, 1), (False, 0)):
        actors = FaultyActors(keys_can_follow=can)
        played(actors, 16 * "a", {"a": {"matched": 0}})
        assert actors.values()["play/faulty_actors"] == count
    late = PRESETS["robot"]
    late = replace(late, play=replace(late.play, actuation_latency=4))
    drawn = replace(late, play=RunConfig().play, randomise=replace(late.randomise, latency=8))
    for config, count in ((PRESETS["robot"], 1), (late, 0), (drawn, 0)):
        phases = Phases(config, RunClock(lambda: 0.0))
        for index in range(16):
            phases.count(chunk(index, "a", matched=0))
        assert phases.values(finishing=False)["play/faulty_actors"] == count


def test_an_actor_that_sends_nothing_any_more_is_forgotten() -> None:
    actors = FaultyActors(keys_can_follow=True)
    blind = {"a": {"valid": 0}}
    played(actors, 16 * "a", blind)
    # The last chunk of a is number 15, and of two actors 64 chunks may be without one of it.
    played(actors, 64 * "b", blind, first=16)
    assert actors.values()["play/faulty_actor_names"] == "a"
    played(actors, "b", blind, first=80)
    assert actors.values()["play/faulty_actor_names"] == ""
    played(actors, 7 * "a", blind, first=81)  # it begins anew
    assert actors.values()["play/faulty_actor_names"] == ""


def test_a_slow_actor_among_quick_ones_stays_known() -> None:
    actors = FaultyActors(keys_can_follow=True)
    names = (["slow"] + 30 * ["quick"]) * 10
    played(actors, names, {"slow": {"follows": 0}})
    assert actors.values()["play/faulty_actor_names"] == "slow"


def test_of_many_faulty_actors_three_are_named() -> None:
    actors = FaultyActors(keys_can_follow=True)
    names = [f"actor-{number}" for number in range(1, 6)]
    played(actors, islice(cycle(names), 5 * 8), {name: {"valid": 0} for name in names})
    assert actors.values() == {
        "play/faulty_actors": 5,
        "play/faulty_actor_names": "actor-1, actor-2, actor-3 and 2 more",
    }


def test_a_recording_is_no_actor() -> None:
    actors = FaultyActors(keys_can_follow=True)
    played(actors, 16 * [DEMONSTRATIONS], {DEMONSTRATIONS: {"matched": 0}})
    assert actors.values()["play/faulty_actors"] == 0
