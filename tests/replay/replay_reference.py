"""A replay of lists, and actors with numbered frames, to compare the real one with.

Written from the definitions and without its tricks: what a transition is comes from the actor's
own complete record of its life; what can be drawn comes from asking, for each stored step, where
each frame of its stack lies and whether the steps of its return are there.
"""

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.protocol.chunk import Chunk, Game
from common.protocol.step_fields import zero_steps
from common.settings.conditions import PlayConfig
from common.settings.config import LearningConfig, ReplayConfig, RunConfig, StreamConfig

RUN = "test"
GOES_ON, TERMINATES, TRUNCATES = 0, 1, 2


class VectorConfig(RunConfig):
    """A run whose states have a vector of three numbers beside their frames."""

    @property
    def vector_width(self) -> int:
        return 3


def make_config(kind: type[RunConfig] = RunConfig, **settings: object) -> RunConfig:
    """A small configuration; ``settings`` go to whichever group has them."""
    defaults: dict[str, object] = {
        "capacity": 64,
        "learning_starts": 1,
        "ratio_tolerance": 1_000_000,
        "batch_size": 16,
        "n_step": 3,
        "discount": 0.9,
    }
    settings = defaults | settings

    def group(of: type[Any]) -> Any:
        names = {each.name for each in dataclasses.fields(of)}
        return of(**{name: value for name, value in settings.items() if name in names})

    return kind(
        play=group(PlayConfig),
        stream=group(StreamConfig),
        replay=group(ReplayConfig),
        learning=group(LearningConfig),
    )


def numbered_frame(number: int) -> NDArray[np.uint8]:
    """A frame that tells its number, and differs from all others nearly everywhere."""
    frame = np.full((84, 84), number * 37 % 256, np.uint8)
    frame[:, 0] = number // 256 % 256
    frame[0, :4] = np.frombuffer(np.uint32(number).tobytes(), np.uint8)
    return frame


def number_of(frame: NDArray[np.uint8]) -> int:
    """The reverse of `numbered_frame`, which also checks every pixel."""
    number = int(frame[0, :4].copy().view(np.uint32)[0])
    assert (frame == numbered_frame(number)).all()
    return number


@dataclass
class Moment:
    """One step as its actor lived it."""

    stack: list[int]
    """Numbers of the frames of the state, oldest first."""
    action: int
    reward: float
    elapsed: int
    ending: int
    valid: bool
    final: int = -1
    """Number of the frame after a truncated step."""


@dataclass
class Actor:
    """Lives numbered moments, and cuts them into chunks."""

    name: str
    frame_stack: int
    width: int = 0
    first_number: int = 0
    moments: list[Moment] = field(default_factory=list)
    sequence: int = 0
    run_id: str = RUN
    _episode: list[int] = field(default_factory=list)

    def live(self, endings: list[int], rng: np.random.Generator) -> Chunk:
        """The next chunk, one step for each of ``endings``."""
        context = self._episode[-(self.frame_stack - 1) :]
        new: list[Moment] = []
        for ending in endings:
            self.first_number += 1
            self._episode.append(self.first_number)
            padded = [self._episode[0]] * self.frame_stack + self._episode
            moment = Moment(
                stack=padded[-self.frame_stack :],
                action=int(rng.integers(18)),
                reward=float(rng.integers(-3, 4)),
                elapsed=int(rng.integers(1, 4)),
                ending=ending,
                valid=bool(rng.random() < 0.8),
            )
            if ending == TRUNCATES:
                self.first_number += 1
                moment.final = self.first_number
            if ending != GOES_ON:
                self._episode = []
            new.append(moment)
        self.moments += new
        chunk = chunk_of(self, context, new)
        self.sequence += 1
        return chunk


def vector_of(number: int, width: int) -> NDArray[np.float32]:
    return np.arange(width, dtype=np.float32) + np.float32(number)


def chunk_of(actor: Actor, context: list[int], moments: list[Moment]) -> Chunk:
    def frames(numbers: list[int]) -> NDArray[np.uint8]:
        shown = [numbered_frame(number) for number in numbers]
        return np.array(shown, np.uint8).reshape(-1, 84, 84)

    def vectors(numbers: list[int]) -> NDArray[np.float32]:
        shown = [vector_of(number, actor.width) for number in numbers]
        return np.array(shown, np.float32).reshape(len(numbers), actor.width)

    newest = [moment.stack[-1] for moment in moments]
    finals = [moment.final for moment in moments if moment.ending == TRUNCATES]
    return Chunk(
        run_id=actor.run_id,
        actor=actor.name,
        incarnation=7,
        stream=0,
        sequence=actor.sequence,
        weights_version=0,
        epsilon=0.5,
        context=frames(context),
        **zero_steps(len(moments), actor.width)
        | {
            "frames": frames(newest),
            "actions": np.array([moment.action for moment in moments], np.uint8),
            "rewards": np.array([moment.reward for moment in moments], np.float32),
            "terminated": np.array([moment.ending == TERMINATES for moment in moments]),
            "truncated": np.array([moment.ending == TRUNCATES for moment in moments]),
            "elapsed": np.array([moment.elapsed for moment in moments], np.uint8),
            "valid": np.array([moment.valid for moment in moments]),
            "follows": np.arange(len(moments)) > 0,
            "matched": np.ones(len(moments), np.bool_),
            "vectors": vectors(newest),
        },
        final_frames=frames(finals),
        final_vectors=vectors(finals),
        games=tuple(Game(1.5, 9) for moment in moments if moment.ending == TERMINATES),
    )


@dataclass
class Expected:
    """One transition; ``s_t`` is None where the episode terminated on the way."""

    s_tm1: list[int]
    action: int
    reward: float
    discount: float
    s_t: list[int] | None


def expected_transition(actor: Actor, number: int, config: RunConfig) -> Expected:
    """The transition from the state whose newest frame has ``number``, from the actor's record."""
    at = [moment.stack[-1] for moment in actor.moments].index(number)
    begin = actor.moments[at]
    reward, discount = 0.0, 1.0
    for step in range(config.learning.n_step):
        moment = actor.moments[at + step]
        gain = moment.reward
        if config.learning.clip_rewards:
            gain = max(-moment.elapsed, min(moment.elapsed, gain))
        reward += discount * gain
        discount *= config.learning.discount**moment.elapsed
        lost = config.learning.losses_end_returns and gain < 0
        if moment.ending == TERMINATES or lost:
            return Expected(begin.stack, begin.action, reward, 0.0, None)
        if moment.ending == TRUNCATES:
            after = [*moment.stack[1:], moment.final]
            return Expected(begin.stack, begin.action, reward, discount, after)
    after = actor.moments[at + config.learning.n_step].stack
    return Expected(begin.stack, begin.action, reward, discount, after)


@dataclass
class _Stored:
    serial: int
    chunk: Chunk
    slots: int
    sources: list[list[int]]
    """For each step: the serials of the chunks that hold the frames of its stack."""


class ListReplay:
    """What can be drawn after a frame_stack of inserts, by lists and searching."""

    def __init__(self, config: RunConfig) -> None:
        self._capacity = config.replay.capacity
        self._frame_stack = config.play.frame_stack
        self._n_step = config.learning.n_step
        self._chunks: list[_Stored] = []
        self._known: set[tuple[str, int]] = set()
        self._serial = 0

    def insert(self, chunk: Chunk) -> bool:
        """False for a duplicate."""
        if (chunk.actor, chunk.sequence) in self._known:
            return False
        self._known.add((chunk.actor, chunk.sequence))
        self._serial += 1
        slots = len(chunk) + len(chunk.final_frames)
        self._make_room(slots)
        before = self._find(chunk.actor, chunk.sequence - 1)
        borrowed: list[int] | None = None
        if len(chunk.context) and before is not None and self._ending(before, -1) == GOES_ON:
            borrowed = before.sources[-1][1:]
            if not self._alive(borrowed):
                borrowed = None
        if borrowed is None:
            slots += len(chunk.context)
            self._make_room(slots)
        own = self._serial
        sources: list[list[int]] = []
        ended = len(chunk.context) == 0
        for step in range(len(chunk)):
            if ended:
                sources.append([own] * self._frame_stack)
            elif step == 0:
                sources.append([*(borrowed or [own] * (self._frame_stack - 1)), own])
            else:
                sources.append([*sources[-1][1:], own])
            ended = bool(chunk.terminated[step] or chunk.truncated[step])
        self._chunks.append(_Stored(own, chunk, slots, sources))
        return True

    def _make_room(self, slots: int) -> None:
        while sum(each.slots for each in self._chunks) + slots > self._capacity:
            self._chunks.pop(0)

    def numbers(self) -> set[int]:
        """Numbers of the newest frames of all states that can be drawn."""
        return {
            number_of(stored.chunk.frames[step])
            for stored in self._chunks
            for step in range(len(stored.chunk))
            if self._alive(stored.sources[step]) and self._return_is_complete(stored, step)
        }

    def steps(self) -> int:
        return sum(len(stored.chunk) for stored in self._chunks)

    def _find(self, actor: str, sequence: int) -> _Stored | None:
        for stored in self._chunks:
            if (stored.chunk.actor, stored.chunk.sequence) == (actor, sequence):
                return stored
        return None

    def _alive(self, serials: list[int]) -> bool:
        return set(serials) <= {stored.serial for stored in self._chunks}

    @staticmethod
    def _ending(stored: _Stored, step: int) -> int:
        if stored.chunk.terminated[step]:
            return TERMINATES
        return TRUNCATES if stored.chunk.truncated[step] else GOES_ON

    def _return_is_complete(self, stored: _Stored, step: int) -> bool:
        for _ in range(self._n_step):
            if self._ending(stored, step) != GOES_ON:
                return True
            step += 1
            if step == len(stored.chunk):
                after = self._find(stored.chunk.actor, stored.chunk.sequence + 1)
                if after is None or len(after.chunk.context) == 0:
                    return False
                stored, step = after, 0
        return self._alive(stored.sources[step])
