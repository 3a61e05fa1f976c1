"""Chunks alone give back what the environments showed: states, endings and games."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from actors.loop import play
from actors.policy import Policy
from actors.stream.chunker import Chunker
from common.network import QNetwork
from common.protocol.chunk import Chunk, Game
from tests.actors.numbered_env import CUT, GAME_OVER, GOES_ON, LOSES_A_LIFE, Moment, NumberedEnv

POLICY = Policy(QNetwork(6), 6, np.random.default_rng(0))  # ε is 1: its network is never asked


@dataclass
class Life:
    """Environments that were played, and the chunks of each."""

    envs: list[NumberedEnv]
    chunks: list[list[Chunk]] = field(default_factory=list)

    def moments(self, stream: int) -> list[Moment]:
        return self.envs[stream].moments


def live(
    scripts: list[list[str]], turns: int, length: int, frame_stack: int = 4, width: int = 0
) -> Life:
    """``turns`` steps of each environment, the last incomplete chunk included."""
    envs = [NumberedEnv(script, frame_stack, 10_000 * i, width) for i, script in enumerate(scripts)]
    life = Life(envs, [[] for _ in envs])
    chunkers = [Chunker("run", "actor", 7, i, length) for i in range(len(envs))]
    policy = Policy(QNetwork(6), 6, np.random.default_rng(0), envs=len(envs))
    for at, step in enumerate(play(envs, policy, [0] * len(envs)), start=1):
        chunk = chunkers[step.stream].add(step)
        if chunk is not None:
            life.chunks[step.stream].append(chunk)
        if at == turns * len(envs):
            break
    for stream, chunker in enumerate(chunkers):
        rest = chunker.cut()
        if rest is not None:
            life.chunks[stream].append(rest)
        assert chunker.cut() is None
    return life


def states_of(
    chunk: Chunk, frame_stack: int
) -> tuple[list[NDArray[np.uint8]], list[NDArray[np.uint8]]]:
    """States of the steps, and after the truncated ones, from this chunk and nothing else."""
    episode, states, finals = list(chunk.context), [], []
    left = list(chunk.final_frames)

    def stacked() -> NDArray[np.uint8]:
        return np.stack(([episode[0]] * frame_stack + episode)[-frame_stack:])

    for t in range(len(chunk)):
        episode.append(chunk.frames[t])
        states.append(stacked())
        if chunk.truncated[t]:
            episode.append(left.pop(0))
            finals.append(stacked())
        if chunk.terminated[t] or chunk.truncated[t]:
            episode = []
    assert not left
    return states, finals


SCRIPTS = st.lists(
    st.sampled_from([GOES_ON, GOES_ON, GOES_ON, LOSES_A_LIFE, GAME_OVER, CUT]),
    min_size=1,
    max_size=25,
)


@settings(max_examples=60)
@given(
    st.lists(SCRIPTS, min_size=1, max_size=3),
    st.integers(1, 40),
    st.integers(1, 9),
    st.integers(2, 6),
)
def test_the_chunks_alone_give_back_every_step(
    scripts: list[list[str]], turns: int, length: int, frame_stack: int
) -> None:
    life = live(scripts, turns, length, frame_stack)
    for stream, chunks in enumerate(life.chunks):
        moments = life.moments(stream)
        assert sum(len(chunk) for chunk in chunks) == len(moments) == turns
        for at, chunk in enumerate(chunks):
            assert len(chunk) == min(length, turns - at * length)
            assert len(chunk.context) < frame_stack
            mine = moments[at * length :][: len(chunk)]
            states, finals = states_of(chunk, frame_stack)
            for state, moment in zip(states, mine, strict=True):
                assert (state == moment.state).all()
            cut = [moment for moment in mine if moment.ending == CUT]
            for final, moment in zip(finals, cut, strict=True):
                assert (final == moment.next_state).all()


@settings(max_examples=40)
@given(SCRIPTS, st.integers(1, 40), st.integers(1, 9), st.integers(0, 3))
def test_the_other_columns_are_what_was_lived_through(
    script: list[str], turns: int, length: int, width: int
) -> None:
    life = live([script], turns, length, width=width)
    for at, chunk in enumerate(life.chunks[0]):
        mine = life.moments(0)[at * length :][: len(chunk)]
        assert chunk.actions.tolist() == [moment.action for moment in mine]
        assert chunk.rewards.tolist() == [moment.reward for moment in mine]
        assert chunk.terminated.tolist() == [m.ending in (LOSES_A_LIFE, GAME_OVER) for m in mine]
        assert chunk.truncated.tolist() == [moment.ending == CUT for moment in mine]
        assert chunk.elapsed.tolist() == [moment.info["elapsed"] for moment in mine]
        assert chunk.valid.tolist() == [moment.valid for moment in mine]
        assert chunk.follows.tolist() == [moment.info["frame_follows"] for moment in mine]
        assert chunk.matched.tolist() == [moment.info["keys_match"] for moment in mine]
        assert chunk.games == tuple(
            Game(moment.info["game_score"], moment.info["game_steps"])
            for moment in mine
            if moment.ending in (GAME_OVER, CUT)
        )
        assert chunk.vectors.shape == (len(mine), width)
        for vector, moment in zip(chunk.vectors, mine, strict=True):
            assert (vector == moment.vector).all()
        cut = [moment for moment in mine if moment.ending == CUT]
        assert chunk.final_vectors.shape == (len(cut), width)
        for vector, moment in zip(chunk.final_vectors, cut, strict=True):
            assert (vector == moment.next_vector).all()


@settings(max_examples=20)
@given(SCRIPTS, st.integers(1, 40), st.integers(1, 9))
def test_what_a_chunker_makes_a_receiver_takes(script: list[str], turns: int, length: int) -> None:
    for chunk in live([script], turns, length).chunks[0]:
        assert (Chunk.decode(chunk.encode()).frames == chunk.frames).all()


def test_chunks_are_numbered_by_stream() -> None:
    life = live([[GOES_ON], [GAME_OVER]], turns=11, length=4)
    for stream, chunks in enumerate(life.chunks):
        assert [chunk.sequence for chunk in chunks] == [0, 1, 2]
        assert [len(chunk) for chunk in chunks] == [4, 4, 3]
        for chunk in chunks:
            assert (chunk.run_id, chunk.actor, chunk.incarnation) == ("run", "actor", 7)
            assert chunk.stream == stream


@pytest.mark.parametrize(
    ("script", "contexts"),
    [
        ([GOES_ON], [0, 3, 3]),
        ([GAME_OVER], [0, 0, 0]),
        ([*[GOES_ON] * 3, GAME_OVER], [0, 1, 2]),
        ([*[GOES_ON] * 4, CUT], [0, 0, 0]),
    ],
)
def test_the_context_is_as_old_as_the_episode(script: list[str], contexts: list[int]) -> None:
    chunks = live([script], turns=15, length=5).chunks[0]
    assert [len(chunk.context) for chunk in chunks] == contexts


def test_a_chunk_is_stamped_with_the_oldest_weights_that_chose_one_of_its_actions() -> None:
    """New ones may come between any two steps, those of one turn included."""
    policy = Policy(QNetwork(6), 6, np.random.default_rng(0), envs=2)
    chunkers = [Chunker("run", "actor", 0, stream, 2) for stream in range(2)]
    made: list[list[Chunk]] = [[], []]
    envs = [NumberedEnv([GOES_ON]), NumberedEnv([GOES_ON])]
    for at, step in enumerate(play(envs, policy, [0, 0])):
        policy.weights_version += 1  # before the chunk is cut, as an actor takes them
        chunk = chunkers[step.stream].add(step)
        if chunk is not None:
            made[step.stream].append(chunk)
        if at == 7:
            break
    # Turns were chosen by versions 0, 2, 4 and 6.
    assert [chunk.weights_version for chunk in made[0]] == [0, 4]
    assert [chunk.weights_version for chunk in made[1]] == [0, 4]


def test_a_learner_that_came_back_with_older_weights_is_not_hidden() -> None:
    policy = Policy(QNetwork(6), 6, np.random.default_rng(0))
    chunker = Chunker("run", "actor", 0, 0, 3)
    for version, step in zip((7, 3, 5), play([NumberedEnv([GOES_ON])], policy, [0]), strict=False):
        chunk = chunker.add(step._replace(weights_version=version))
    assert chunk is not None
    assert chunk.weights_version == 3


def test_a_chunk_is_stamped_with_the_epsilon_of_its_last_action() -> None:
    policy = Policy(QNetwork(6), 6, np.random.default_rng(0))
    chunker = Chunker("run", "actor", 0, 0, 2)
    made: list[Chunk] = []
    for at, step in enumerate(play([NumberedEnv([GOES_ON])], policy, [0])):
        policy.epsilon /= 2
        chunk = chunker.add(step)
        if chunk is not None:
            made.append(chunk)
        if at == 3:
            break
    assert [chunk.epsilon for chunk in made] == [0.5, 0.125]
