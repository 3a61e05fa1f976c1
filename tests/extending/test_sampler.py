"""A sampler of an installed package draws in the replay, and hears of what the learner learned."""

import json
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.entry_point import add_entry_point
from common.command_line.played import playing_settings
from common.errors import InputError
from common.network import build_network
from common.registry import SAMPLERS, SamplerKind
from common.run.announcement import Announcement
from common.run.network_file import encode_network_file
from common.run.rules import check_config
from replay.replay_buffer import ReplayBuffer
from replay.samplers import UniformSampler
from tests.end_to_end.conftest import SMALL, Stage
from tests.extending.toy_sampler import NEWEST
from tests.extending.whole_run import added
from tests.replay.replay_reference import GOES_ON, Actor, make_config


def test_it_draws_and_hears_of_priorities_after_a_restart_too(tmp_path: Path) -> None:
    config = make_config(sampler="newest", sampler_settings="newest=5")
    with added(SAMPLERS, NEWEST):
        buffer, rng = ReplayBuffer(config, tmp_path), np.random.default_rng(0)
        buffer.insert(Actor("a", 4).live([GOES_ON] * 40, rng))
        drawn = ids_of(buffer)
        buffer.update_priorities(np.array(sorted(drawn)), np.ones(len(drawn), np.float32))
        buffer.close()
        assert len(drawn) == 5
        again = ReplayBuffer(config, tmp_path)
        assert ids_of(again) == drawn
        again.close()
    counts = np.fromfile(tmp_path / "priorities.bin", np.float64)
    assert np.flatnonzero(counts).tolist() == sorted(drawn)


def test_actors_join_and_its_policy_plays_without_its_package(tmp_path: Path) -> None:
    config = make_config(
        sampler="newest", sampler_settings="newest=5", learning_starts=20, capacity=200
    )
    with pytest.raises(InputError, match=r"^there is no sampler 'newest': choose "):
        check_config(config)
    told = Announcement("r", config, config.action_count, "id")
    assert Announcement.decode(told.encode()) == told
    weights = tmp_path / "w.safetensors"
    weights.write_bytes(encode_network_file(build_network(config, config.action_count), config))
    assert playing_settings(weights) == config.for_play


def _drawing(draw: Callable[..., Any]) -> SamplerKind:
    kind = type("Wrong", (UniformSampler,), {"draw": draw})
    return SamplerKind("wrong", lambda capacity, ids, leaves, config: kind(capacity, ids))


def _fails(*_: object) -> None:
    raise KeyError("mine")


ONES = np.ones(16, np.float32)


@pytest.mark.parametrize(
    ("draw", "told"),
    [
        (lambda own, rng, n: (own.ids[:n] + 1e3, ONES), "draws float64 [16] and float32 [16]: ret"),
        (lambda own, rng, n: (own.ids[:9], ONES), "draws int64 [9] and float32 [16]: return ids"),
        (lambda own, rng, n: (own.ids[:n], np.ones(n)), "float64 [16]: return ids int64 [16] and "),
        (lambda own, rng, n: (own.ids[:n] - 1000, ONES), "which is not in its set: draw from its"),
        (lambda own, rng, n: (own.ids[:n], ONES * np.nan), "gives negative or non-finite weights:"),
        (lambda own, rng, n: (own.ids[:n], -ONES), "gives negative or non-finite weights: give"),
        (lambda own, n: (own.ids[:n], ONES), "fails (TypeError("),
        (
            _fails,
            f"fails (KeyError('mine'), {__file__}:{_fails.__code__.co_firstlineno + 1}): mend",
        ),
    ],
)
def test_a_wrong_draw_is_refused(draw: Callable[..., Any], told: str, tmp_path: Path) -> None:
    config, rng = make_config(sampler="wrong"), np.random.default_rng(0)
    with added(SAMPLERS, _drawing(draw)):
        buffer = ReplayBuffer(config, tmp_path)
        buffer.insert(Actor("a", 4).live([GOES_ON] * 40, rng))
        with pytest.raises(InputError) as error:
            buffer.sample(0, 0.0)
        buffer.close()
    assert str(error.value).startswith("the sampler 'wrong' ")
    assert told in str(error.value)


@pytest.mark.parametrize("method", ["add", "remove", "update"])
def test_a_method_that_fails_is_told_and_nothing_is_drawn_any_more(
    method: str, tmp_path: Path
) -> None:
    kind = type("Wrong", (UniformSampler,), {method: _fails})
    wrong = SamplerKind("wrong", lambda capacity, ids, leaves, config: kind(capacity, ids))
    config, rng = make_config(sampler="wrong", capacity=64), np.random.default_rng(0)
    actor = Actor("a", 4)
    with added(SAMPLERS, wrong), closing(ReplayBuffer(config, tmp_path)) as buffer:
        assert buffer.progress(0).failed == ""

        def live_until_the_ring_turns() -> None:
            for _ in range(3):
                buffer.insert(actor.live([GOES_ON] * 30, rng))
                buffer.update_priorities(np.arange(1), np.ones(1, np.float32))

        with pytest.raises(InputError) as error:
            live_until_the_ring_turns()
        line = _fails.__code__.co_firstlineno + 1
        told = f"the sampler 'wrong' fails (KeyError('mine'), {__file__}:{line}): mend its package."
        assert str(error.value) == buffer.progress(0).failed == told
        with suppress(InputError):
            assert buffer.sample(0, 0.0) is None


@pytest.mark.parametrize("name", ["__len__", "contains", "ids"])
def test_one_that_answers_for_the_set_itself_is_refused(name: str, tmp_path: Path) -> None:
    kind = type("Wrong", (UniformSampler,), {name: _fails})
    wrong = SamplerKind("wrong", lambda capacity, ids, leaves, config: kind(capacity, ids))
    told = f"^the sampler 'wrong' overrides {name}: leave it to UniformSampler, and override draw."
    with added(SAMPLERS, wrong), pytest.raises(InputError, match=told):
        ReplayBuffer(make_config(sampler="wrong"), tmp_path)


@pytest.mark.parametrize(
    ("factory", "told"),
    [
        (lambda *_: None, "returns NoneType: return a UniformSampler"),
        (lambda capacity, ids: UniformSampler(capacity, ids), "fails (TypeError("),
        ("tests.extending.toy_sampler:NEWST", "has no attribute 'NEWST'"),
    ],
)
def test_a_wrong_factory_is_refused(factory: Any, told: str, tmp_path: Path) -> None:
    config = make_config(sampler="wrong")
    with added(SAMPLERS, SamplerKind("wrong", factory)), pytest.raises(InputError) as error:
        ReplayBuffer(config, tmp_path / "replay")
    assert str(error.value).startswith("the factory of the sampler 'wrong' ")
    assert told in str(error.value)
    assert not (tmp_path / "replay").exists()


def ids_of(buffer: ReplayBuffer) -> set[int]:
    """Returns the ids in 20 minibatches."""
    batches = [buffer.sample(0, 0.0) for _ in range(20)]
    return {int(each) for batch in batches if batch is not None for each in batch.ids}


@pytest.fixture
def _installed(stage: Stage) -> None:
    place = "tests.extending.toy_sampler:NEWEST"
    add_entry_point(stage.folder, "toy-sampler", "sampler", "newest", place)


@pytest.mark.usefixtures("_installed")
def test_a_run_draws_by_it(stage: Stage) -> None:
    learner = stage.learner(
        *("--env", "ale", "--replay.sampler", "newest", "--steps", "300", *SMALL),
        *("--replay.sampler-settings", "newest=50"),
    )
    stage.actor("a")

    learner.ends()

    assert stage.summary()["updates"] >= (300 - 200) // 4
    config = json.loads((stage.run / "config.json").read_text())
    assert config["replay"]["sampler"] == "newest"
    assert config["replay"]["sampler_settings"] == "newest=50"
    counts = np.fromfile(stage.run / "replay" / "priorities.bin", np.float64)
    assert counts.sum() > 0
    assert not counts[:100].any()  # older than the newest 50 when learning started


FORGETFUL = SamplerKind(
    "forgetful",
    lambda capacity, ids, *_: type("Forgetful", (UniformSampler,), {"add": _fails})(capacity, ids),
)


def test_one_that_fails_ends_the_replay_of_its_own_process(stage: Stage) -> None:
    place = "tests.extending.test_sampler:FORGETFUL"
    add_entry_point(stage.folder, "forgetful-sampler", "sampler", "forgetful", place)
    replay = stage.start(
        *("-m", "replay", "--run=r", "--listen", stage.endpoint, "--env=ale", *SMALL),
        "--replay.sampler=forgetful",
    )
    replay.says("0 stored")
    stage.actor("a")

    said = replay.ends(2)

    assert said.splitlines()[-1].startswith(
        "error: the sampler 'forgetful' fails (KeyError('mine')"
    )
    assert "Traceback" not in said
