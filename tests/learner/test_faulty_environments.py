"""Single environments that do not see or touch, found among others that do."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import cycle, islice

import pytest

from common.protocol.run_keys import DEMONSTRATIONS
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from learner import faulty_environments
from learner.faulty_environments import FaultyEnvironments
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
    actors: FaultyEnvironments,
    names: Iterable[str],
    faults: dict[str, dict[str, int]],
    first: int = 0,
) -> None:
    for index, name in enumerate(names, first):
        actors.add(chunk(index, name, **faults.get(name, {})))


@pytest.mark.parametrize("share", ["valid", "follows", "matched"])
def test_one_faulty_robot_of_eight_is_named_by_a_check_that_ends_no_run(share: str) -> None:
    config = PRESETS["robot"]
    phases = Phases(config, RunClock(lambda: 0.0))
    names = [f"actor-{number}" for number in range(8)]
    for index, name in enumerate(islice(cycle(names), 8 * 16)):
        phases.count(chunk(index, name, **({share: 4} if name == "actor-3" else {})))
    checks = {check.name: check for check in judge(phases.values(), config)}
    # Its steps do not show in the mean of all, which is what the other checks judge.
    assert checks["keys as commanded"].passed
    assert "following frames" not in checks
    found = checks["faulty environments"]
    assert (found.value, found.passed, found.stops) == (1.0, False, False)
    assert found.why.endswith(": actor-3")


def test_robots_that_see_and_touch_are_not_listed() -> None:
    actors = FaultyEnvironments(keys_can_follow=True)
    played(actors, islice(cycle("ab"), 100), {"a": {"valid": 32, "follows": 32, "matched": 32}})
    assert actors.values() == {"play/faulty_environments": 0, "play/faulty_actors": ""}
    assert "faulty environments" not in {
        check.name for check in judge(actors.values(), PRESETS["robot"])
    }


def test_an_actor_is_judged_after_eight_chunks_and_by_its_newest_sixteen() -> None:
    actors = FaultyEnvironments(keys_can_follow=True)
    played(actors, 7 * "a", {"a": {"valid": 31}})
    assert actors.values()["play/faulty_environments"] == 0
    played(actors, "a", {"a": {"valid": 31}}, first=7)
    assert actors.values()["play/faulty_environments"] == 1
    played(actors, 8 * "a", {"a": {"valid": 33}}, first=8)  # half of all steps
    assert actors.values()["play/faulty_environments"] == 0
    played(actors, 9 * "a", {"a": {"valid": 0}}, first=16)  # the first eight do not count any more
    assert actors.values()["play/faulty_environments"] == 1
    played(actors, 9 * "a", {}, first=25)
    assert actors.values()["play/faulty_environments"] == 0


def test_hands_that_cannot_follow_in_time_are_not_judged() -> None:
    for can, count in ((True, 1), (False, 0)):
        actors = FaultyEnvironments(keys_can_follow=can)
        played(actors, 16 * "a", {"a": {"matched": 0}})
        assert actors.values()["play/faulty_environments"] == count
    late = PRESETS["robot"]
    late = replace(late, play=replace(late.play, actuation_latency=4))
    drawn = replace(
        late, play=RunConfig().play, randomise=replace(late.randomise, actuation_latency=8)
    )
    for config, count in ((PRESETS["robot"], 1), (late, 0), (drawn, 0)):
        phases = Phases(config, RunClock(lambda: 0.0))
        for index in range(16):
            phases.count(chunk(index, "a", matched=0))
        assert phases.values()["play/faulty_environments"] == count


def test_an_actor_that_sends_nothing_any_more_is_forgotten() -> None:
    actors = FaultyEnvironments(keys_can_follow=True)
    blind = {"a": {"valid": 0}}
    played(actors, 16 * "a", blind)
    # The last chunk of a is number 15, and of two actors 64 chunks may be without one of it.
    played(actors, 64 * "b", blind, first=16)
    assert actors.values()["play/faulty_actors"] == "a"
    played(actors, "b", blind, first=80)
    assert actors.values()["play/faulty_actors"] == ""
    played(actors, 7 * "a", blind, first=81)  # it begins anew
    assert actors.values()["play/faulty_actors"] == ""


def test_a_slow_actor_among_quick_ones_stays_known() -> None:
    actors = FaultyEnvironments(keys_can_follow=True)
    names = (["slow"] + 30 * ["quick"]) * 10
    played(actors, names, {"slow": {"follows": 0}})
    assert actors.values()["play/faulty_actors"] == "slow"


def test_of_many_faulty_actors_three_are_named() -> None:
    actors = FaultyEnvironments(keys_can_follow=True)
    names = [f"actor-{number}" for number in range(1, 6)]
    played(actors, islice(cycle(names), 5 * 8), {name: {"valid": 0} for name in names})
    assert actors.values() == {
        "play/faulty_environments": 5,
        "play/faulty_actors": "actor-1, actor-2, actor-3 and 2 more",
    }


def test_one_faulty_environment_of_an_actor_is_found() -> None:
    actors = FaultyEnvironments(keys_can_follow=True)
    for index in range(16 * 8):
        stream = index % 16
        blind = {"valid": 0} if stream in (3, 4) else {}
        actors.add(chunk(index, "a", **blind, stream=stream))
    found = actors.values()
    assert (found["play/faulty_environments"], found["play/faulty_actors"]) == (2, "a")


def test_an_actor_that_names_ever_new_streams_makes_nothing_grow(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(faulty_environments, "_MOST", 10)
    actors = FaultyEnvironments(keys_can_follow=True)
    for index in range(8 * 10):  # ten streams may be judged
        actors.add(chunk(index, "a", valid=0, stream=index % 10))
    assert actors.values()["play/faulty_environments"] == 10
    for index in range(80, 90):
        actors.add(chunk(index, "b", stream=index))
    assert actors.values()["play/faulty_environments"] == 0


def test_a_recording_is_no_actor() -> None:
    actors = FaultyEnvironments(keys_can_follow=True)
    played(actors, 16 * [DEMONSTRATIONS], {DEMONSTRATIONS: {"matched": 0}})
    assert actors.values()["play/faulty_environments"] == 0
