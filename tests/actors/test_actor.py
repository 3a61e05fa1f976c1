"""A training actor, with a replay that the test plays."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from actors import actor as actor_module
from actors.actor import Actor
from actors.envs.checked import CheckedEnv
from actors.member import Member
from actors.policy import Policy
from actors.policy_sync import PolicySync
from actors.stream import insert_client, weights_client
from actors.stream.weights_client import WeightsClient
from common.counted import counted
from common.errors import InputError
from common.network import QNetwork
from common.protocol.actor_stats import ActorStats
from common.protocol.chunk import Chunk
from common.protocol.run_keys import RunKeys
from common.protocol.weights import encode_weights
from common.settings.config import StreamConfig
from common.settings.presets import PRESETS
from common.transport.interface import Envelope, Request, Transport
from tests.actors.numbered_env import CUT, GAME_OVER, GOES_ON, NumberedEnv
from tests.hub_stubs import STORED
from tests.patience import PATIENCE, wait_until

KEYS = RunKeys("r")
CONFIG = replace(PRESETS["fast"], stream=StreamConfig(chunk_steps=8, window=2))
SCRIPT = [*[GOES_ON] * 4, GAME_OVER, GOES_ON, CUT]


class Replay:
    """Stores every chunk and answers ``ack``; after ``limit`` chunks the run is finished."""

    def __init__(self, hub: Transport) -> None:
        self.ack = STORED
        self.limit = 10**9
        self.silent = False
        self.unanswered = 0
        self.polls = 0
        self.chunks: list[Chunk] = []
        hub.serve(KEYS.insert("*"), self._answer)

    def _answer(self, request: Request) -> bytes | None:
        payload = request.payload
        if self.silent:
            self.unanswered += bool(payload)
            request.drop()
            return None
        if payload:
            self.chunks.append(Chunk.decode(payload))
        self.polls += not payload
        finished = self.ack.finished or len(self.chunks) >= self.limit
        status = self.ack.status if payload else "poll"
        return replace(self.ack, status=status, finished=finished).encode()


class Stage:
    """An actor at work in a thread."""

    def __init__(self, hub: Transport, client: Transport) -> None:
        self.hub = hub
        self.replay = Replay(hub)
        self.warnings: list[str] = []
        self.stop = threading.Event()
        self.config = CONFIG
        self.policy = Policy(QNetwork(6), 6, np.random.default_rng(0))
        self.stats: list[ActorStats] = []
        self.failure: str | None = None
        self._client = client
        self._served: Envelope | None = None
        self._thread: threading.Thread | None = None
        hub.subscribe(KEYS.stats("actor", "a"), self._hear_stats)

    def _hear_stats(self, message: Envelope) -> None:
        self.stats.append(ActorStats.decode(message.payload))

    def start(self, *envs: NumberedEnv) -> None:
        member = Member(
            *("a", self._client, KEYS, self.config, 300.0, self.stop, 17, self.warnings.append)
        )
        shown = [CheckedEnv(env, self.config) for env in envs]
        self.actor = actor = Actor(member, shown, self.policy)
        seeds = list(range(len(envs)))

        def work() -> None:
            try:
                actor.run(seeds)
            except InputError as error:
                self.failure = str(error)

        self._thread = threading.Thread(target=work, daemon=True)
        self._thread.start()

    def has(self, chunks: int) -> None:
        wait_until(lambda: len(self.replay.chunks) >= chunks, f"{chunks} chunks are stored")

    def ended(self) -> None:
        assert self._thread is not None
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()

    def farewell(self) -> ActorStats:
        wait_until(lambda: self.stats and self.stats[-1].leaving, "it says good-bye")
        return self.stats[-1]

    def serve_weights(self, version: int, payload: bytes) -> None:
        if self._served is None:
            self.hub.serve(KEYS.latest_weights, lambda _: self._served)
        self._served = Envelope(payload, b"%d" % version)


@pytest.fixture
def stage(hub: Transport, client: Transport, monkeypatch: pytest.MonkeyPatch) -> Iterator[Stage]:
    # An answer that is slow on a busy machine is still one.
    monkeypatch.setattr(actor_module, "FAREWELL", PATIENCE)
    monkeypatch.setattr(insert_client, "ACK_TIMEOUT", PATIENCE)
    monkeypatch.setattr(weights_client, "_FETCH_TIMEOUT", PATIENCE)
    stage = Stage(hub, client)
    yield stage
    stage.stop.set()
    stage.ended()


def test_everything_it_lived_through_is_stored_once_and_in_order(stage: Stage) -> None:
    envs = [NumberedEnv(SCRIPT), NumberedEnv([GOES_ON], first=1_000)]
    stage.policy = Policy(QNetwork(6), 6, np.random.default_rng(0), envs=2)
    stage.replay.limit = 5
    stage.start(*envs)
    stage.ended()
    for stream, env in enumerate(envs):
        chunks = [chunk for chunk in stage.replay.chunks if chunk.stream == stream]
        assert [chunk.sequence for chunk in chunks] == list(range(len(chunks)))
        assert all((c.run_id, c.actor, c.incarnation) == ("", "a", 17) for c in chunks)
        frames = np.concatenate([chunk.frames for chunk in chunks])
        assert (frames == [moment.state[-1] for moment in env.moments]).all()
        actions = np.concatenate([chunk.actions for chunk in chunks])
        assert actions.tolist() == [moment.action for moment in env.moments]
    last = stage.farewell()
    assert last.steps == sum(len(env.moments) for env in envs)
    assert last.made == last.acked == len(stage.replay.chunks)
    assert (last.retried, last.refused, last.role, last.incarnation) == (0, 0, "actor", 17)
    left = f"a: left after {last.steps} steps, all of them stored."
    assert stage.warnings == ["a: the run is finished.", left]


def test_a_wish_to_stop_in_the_middle_of_a_chunk_loses_no_step(stage: Stage) -> None:
    class Stopping(NumberedEnv):
        def step(self, action: np.int64 | int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
            if len(self.moments) == 11:
                stage.stop.set()
            return super().step(action)

    env = Stopping([GOES_ON])
    stage.start(env)
    stage.ended()
    assert len(env.moments) == 12
    assert [len(chunk) for chunk in stage.replay.chunks] == [8, 4]
    last = stage.farewell()
    assert (last.made, last.acked) == (2, 2)


def test_epsilon_follows_the_runs_steps(stage: Stage) -> None:
    half_way = CONFIG.replay.learning_starts + CONFIG.exploration.steps // 2
    stage.serve_weights(0, encode_weights(QNetwork(6)))
    stage.replay.ack = replace(STORED, agent_steps=half_way)
    stage.replay.limit = 1
    stage.start(NumberedEnv([GOES_ON]))
    stage.ended()
    assert stage.replay.chunks[0].epsilon == pytest.approx(0.51)
    assert stage.policy.epsilon == pytest.approx(0.51)


def test_the_next_game_has_the_difficulty_that_was_told_last(stage: Stage) -> None:
    stage.config = replace(CONFIG, learning=replace(CONFIG.learning, curriculum_steps=1_000))
    stage.replay.ack = replace(STORED, difficulty=0.25)
    stage.replay.limit = 1
    env = NumberedEnv([GOES_ON, GAME_OVER])
    stage.start(env)
    stage.ended()
    assert {told["difficulty"] for told in env.options if told} == {0.25}


def test_without_a_curriculum_no_environment_is_given_an_option(stage: Stage) -> None:
    stage.replay.limit = 1
    env = NumberedEnv([GOES_ON, GAME_OVER])
    stage.start(env)
    stage.ended()
    assert not any(env.options)


def test_while_the_learner_is_behind_it_pauses(stage: Stage) -> None:
    env = NumberedEnv([GOES_ON])
    stage.replay.ack = replace(STORED, throttle=True)
    stage.start(env)
    stage.has(1)
    # The window lets a second chunk go before the first answer is read, no more.
    wait_until(lambda: stage.replay.polls >= 20, "it has polled often")
    stored, lived = len(stage.replay.chunks), len(env.moments)
    assert stored <= CONFIG.stream.window
    wait_until(lambda: stage.replay.polls >= 40, "it has polled again and again")
    assert (len(stage.replay.chunks), len(env.moments)) == (stored, lived)
    assert stage.actor._counters.throttled_seconds > 0  # before the pause has ended
    stage.replay.ack = STORED
    stage.has(stored + 3)
    stage.stop.set()
    stage.ended()
    assert len(env.moments) > lived


def test_no_game_time_passes_while_it_waits(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    """For the learner that is behind, for room in the window, and for weights that it missed."""
    pauses: list[str] = []

    @contextmanager
    def paused(env: CheckedEnv) -> Iterator[None]:
        name = "ab"[env is not stage.actor._envs[0]]
        pauses.append(f"{name} begins")
        yield
        pauses.append(f"{name} ends")

    monkeypatch.setattr(CheckedEnv, "paused", paused)
    monkeypatch.setattr(WeightsClient, "fetch", lambda self: pauses.append("fetch"))
    begins, ends = ["a begins", "b begins"], ["b ends", "a ends"]
    stage.policy = Policy(QNetwork(6), 6, np.random.default_rng(0), envs=2)
    stage.start(NumberedEnv([GOES_ON]), NumberedEnv([GOES_ON]))
    stage.has(1)
    assert pauses[:5] == [*begins, "fetch", *ends]
    monkeypatch.setattr(PolicySync, "follow", lambda *_: None)  # which pauses too
    stage.has(8)
    stage.replay.ack = replace(STORED, throttle=True)
    wait_until(lambda: stage.replay.polls >= 20, "it has polled often")
    assert pauses[-2:] == begins
    stage.replay.ack = replace(STORED, finished=True)
    stage.ended()
    assert pauses[-2:] == ends
    assert stage.actor._inserts._paused == stage.actor._paused


def test_a_finished_run_ends_it_even_in_a_pause(stage: Stage) -> None:
    stage.replay.ack = replace(STORED, throttle=True)
    stage.start(NumberedEnv([GOES_ON]))
    wait_until(lambda: stage.replay.polls >= 5, "it pauses")
    stage.replay.ack = replace(STORED, throttle=True, finished=True)
    stage.ended()
    assert stage.farewell().leaving
    assert stage.warnings.count("a: the run is finished.") == 1


def test_a_run_that_ends_while_it_plays_is_left_before_the_next_chunk(stage: Stage) -> None:
    class Slow(NumberedEnv):
        def step(self, action: np.int64 | int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
            if len(self.moments) == CONFIG.stream.chunk_steps:
                wait_until(lambda: stage.actor._inserts.acked, "the first chunk is acknowledged")
            return super().step(action)

    env = Slow([GOES_ON])
    stage.replay.limit = 1
    stage.start(env)
    stage.ended()
    assert len(env.moments) <= CONFIG.stream.chunk_steps + 1


def test_a_run_that_is_over_is_left_at_once(stage: Stage) -> None:
    env = NumberedEnv([GOES_ON])
    stage.replay.ack = replace(STORED, finished=True)
    stage.start(env)
    stage.ended()
    assert not env.moments
    assert not stage.replay.chunks
    assert stage.warnings == [
        "a: the run has all its steps already: resume its learner with more --steps, then start "
        "this actor again."
    ]


def test_whoever_has_no_weights_fetches_the_newest(stage: Stage) -> None:
    learned = encode_weights(QNetwork(6))
    stage.serve_weights(5, learned)
    stage.replay.ack = replace(STORED, weights_version=5)
    stage.replay.limit = 1
    stage.start(NumberedEnv([GOES_ON]))
    stage.ended()
    assert stage.replay.chunks[0].weights_version == 5
    assert encode_weights(stage.policy.network) == learned


def test_weights_that_come_before_a_chunk_is_cut_do_not_stamp_it(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    env, payload = NumberedEnv([GOES_ON]), encode_weights(QNetwork(6))
    # New ones after each step, so that those of step t are version t.
    monkeypatch.setattr(WeightsClient, "fetch", lambda _: None)
    monkeypatch.setattr(WeightsClient, "take", lambda _: (len(env.moments), payload, b""))
    stage.replay.limit = 3
    stage.start(env)
    stage.ended()
    assert [chunk.weights_version for chunk in stage.replay.chunks[:3]] == [0, 8, 16]


def test_weights_before_the_first_update_are_played_by_as_well(stage: Stage) -> None:
    given = encode_weights(QNetwork(6))
    stage.serve_weights(0, given)
    stage.replay.limit = 1
    stage.start(NumberedEnv([GOES_ON]))
    stage.ended()
    assert stage.replay.chunks[0].weights_version == 0
    assert encode_weights(stage.policy.network) == given


def test_weights_that_are_only_a_broadcast_behind_are_not_fetched(stage: Stage) -> None:
    mine = encode_weights(QNetwork(6))
    stage.serve_weights(100, mine)
    slack = 2 * CONFIG.learning.publish_period
    stage.replay.ack = replace(STORED, weights_version=100 + slack)
    stage.start(NumberedEnv([GOES_ON]))
    stage.has(1)
    stage.serve_weights(100 + slack, encode_weights(QNetwork(6)))
    stage.has(4)
    assert {chunk.weights_version for chunk in stage.replay.chunks} == {100}
    stage.replay.ack = replace(STORED, weights_version=101 + slack)
    wait_until(lambda: stage.policy.weights_version == 100 + slack, "it has fetched")
    stage.stop.set()
    stage.ended()
    assert encode_weights(stage.policy.network) != mine


def test_a_learner_that_comes_back_with_older_weights_is_followed(stage: Stage) -> None:
    before, after = (encode_weights(QNetwork(6)) for _ in range(2))
    stage.serve_weights(100_000, before)
    stage.replay.ack = replace(STORED, weights_version=100_000)
    stage.start(NumberedEnv([GOES_ON]))
    wait_until(lambda: stage.policy.weights_version == 100_000, "it has fetched")
    stage.serve_weights(50, after)
    stage.replay.ack = replace(STORED, weights_version=50)
    wait_until(lambda: stage.policy.weights_version == 50, "it has fetched again")
    stage.stop.set()
    stage.ended()
    assert encode_weights(stage.policy.network) == after


def test_broadcast_weights_are_used_and_stamped(stage: Stage) -> None:
    learned = encode_weights(QNetwork(6))
    stage.start(NumberedEnv([GOES_ON]))
    stage.has(1)

    def arrived() -> bool:
        stage.hub.publisher(KEYS.weights).publish(learned, b"7")
        return stage.policy.weights_version == 7

    wait_until(arrived, "the broadcast is taken")
    stage.has(len(stage.replay.chunks) + 3)
    stage.stop.set()
    stage.ended()
    assert stage.replay.chunks[-1].weights_version == 7
    assert encode_weights(stage.policy.network) == learned


def test_weights_that_do_not_fit_are_told_and_not_used(stage: Stage) -> None:
    mine = encode_weights(stage.policy.network)
    stage.serve_weights(5, encode_weights(QNetwork(18)))
    stage.replay.ack = replace(STORED, weights_version=5)
    stage.start(NumberedEnv([GOES_ON]))
    stage.has(1)
    stage.stop.set()
    stage.ended()
    assert "weights 5 were not used: " in stage.warnings[0]
    assert encode_weights(stage.policy.network) == mine
    assert stage.policy.weights_version == 0


def test_a_replay_that_falls_silent_is_told_at_the_end(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(actor_module, "FAREWELL", 0.1)
    stage.start(NumberedEnv([GOES_ON]))
    stage.has(1)
    stage.replay.silent = True
    wait_until(lambda: stage.replay.unanswered, "a chunk is not answered")
    stage.stop.set()
    stage.ended()
    last = stage.farewell()
    assert last.made > last.acked
    missing = counted(last.made - last.acked, "chunk")
    assert stage.warnings == [f"a: the replay did not acknowledge the last {missing}."]


def test_an_actor_leaves_a_hub_that_serves_another_run_now(stage: Stage) -> None:
    stage.start(NumberedEnv([GOES_ON]))
    stage.has(2)
    stage.replay.ack = replace(STORED, status="refused", run_id="another")
    stage.ended()
    assert stage.failure == (
        "the hub now serves a different run under the name r, and refuses a, which joined the "
        "former one: start this process again to join it."
    )
    assert stage.farewell().refused >= 1
