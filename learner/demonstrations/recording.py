"""A recording, checked against a run and turned into its chunks."""

from collections.abc import Iterator
from itertools import count, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import InputError, MessageError
from common.process.extras import extra_for
from common.protocol.actor_stats import ActorStats
from common.protocol.chunk import Chunk
from common.protocol.run_keys import DEMONSTRATIONS
from common.settings.config import RunConfig
from common.settings.fit import VECTOR_PARTS, VECTOR_SETTINGS, as_flag
from common.settings.stored_config import flat
from learner.demonstrations.record import DemonstrationsRecord

_ALIKE = (
    "game",
    "play.frame_stack",
    "play.frame_skip",
    "play.minimal_actions",
    *VECTOR_SETTINGS,
    "learning.clip_rewards",
)
"""Settings that must be equal, because states, actions or rewards depend on them."""


class Demonstrations:
    """A recording, turned into chunks of a run.

    Attributes:
        config: the run's configuration.
        stats: the counters of the actor that sends all chunks.
        begun: the record of them before they are sent.
    """

    def __init__(self, path: Path, config: RunConfig) -> None:
        """Reads the whole recording, and compares it with the run's ``config``.

        Raises:
            InputError: the recording is damaged, was played under other settings than the run's,
                or does not fit into its replay; or pyarrow is missing.
        """
        with extra_for("--demonstrations", "record"):
            from common.dataset.reader import Dataset
        self.config = config
        self._dataset = Dataset(path)
        self._refuse_others(path)
        self.stats = stats = self._counted(path)
        if not stats.steps:
            raise InputError(f"{path} has no step to learn from: record whole games.")
        waits, discount = stats.decisions > stats.steps, self._dataset.config.learning.discount
        if waits and discount != config.learning.discount:
            raise InputError(
                f"the rewards in {path} were discounted with another --learning.discount: give "
                f"the run {discount:g}, or record others."
            )
        if self._slots > config.replay.capacity:
            raise InputError(
                f"{path} has {stats.steps:,} steps, too many for the replay: raise "
                f"--replay.capacity to {self._slots:,} at least, or record fewer."
            )
        self.begun = DemonstrationsRecord(
            str(path.resolve()), self._dataset.fingerprint, stats.steps
        )
        stats.incarnation = int(self.begun.fingerprint[:15], 16)

    def _refuse_others(self, path: Path) -> None:
        both = self._dataset.config, self.config
        recorded, wanted = (flat(each) | {"game": each.task} for each in both)
        names = [name for name in _ALIKE if recorded[name] != wanted[name]]
        if not recorded["play.vector"]:  # then its contents mean nothing
            names = [name for name in names if name not in VECTOR_PARTS]
        unequal = [f"{name} {recorded[name]} instead of {wanted[name]}" for name in names]
        widths = self._dataset.config.vector_width, self.config.vector_width
        if not unequal and widths[0] != widths[1]:
            names, unequal = ["play.robot"], ["vectors of {} numbers instead of {}".format(*widths)]
        if unequal:
            if recorded["game"] != self._dataset.config.game or wanted["game"] != self.config.game:
                names = ["env", *names]  # one of them has no Atari game
            flags = " ".join(as_flag(name, self._dataset.config) for name in names)
            raise InputError(
                f"the demonstrations in {path} have {', '.join(unequal)}: give the run {flags}, or "
                "record others."
            )

    def _counted(self, path: Path) -> ActorStats:
        """Returns the counters of the actor that sends all chunks, each of which it checks."""
        stats = ActorStats(DEMONSTRATIONS, "actor", epsilon=0.0)
        self._slots = 0  # those of the replay that they take, with the last frames of cut games
        for chunk in self._chunks("", 0):
            stats.made += 1
            stats.steps += len(chunk)
            self._slots += len(chunk) + len(chunk.final_frames)
            stats.valid += int(np.count_nonzero(chunk.valid))
            stats.matched += int(np.count_nonzero(chunk.matched))
            stats.decisions += int(chunk.elapsed.sum())
            try:
                Chunk.decode(chunk.encode())
            except MessageError as error:
                raise InputError(f"{path} is damaged ({error}): name another recording.") from None
            if (chunk.actions >= self.config.action_count).any():
                raise InputError(
                    f"{path} has actions that this run does not have: record with the same "
                    "--play.minimal-actions."
                )
        return stats

    def chunks(self, run_id: str) -> Iterator[Chunk]:
        """Yields the steps as chunks of the run.

        Raises:
            InputError: the recording is not what it was, which is known once it has been read.
        """
        yield from self._chunks(run_id, self.stats.incarnation)
        if self._dataset.fingerprint != self.begun.fingerprint:
            raise InputError(
                f"{self.begun.path} was changed while it was read: begin a new run with it."
            )

    def _chunks(self, run_id: str, incarnation: int) -> Iterator[Chunk]:
        """Yields the steps, episode by episode.

        A recording has the state before each step, but not the state after the last one. So an
        episode that was cut short loses its last step, and the step before it is truncated.
        """
        length, context = self.config.stream.chunk_steps, self.config.play.frame_stack - 1
        sequence = count()
        for rows in self._episodes():
            truncated = bool(rows["truncated"][-1])
            last = len(rows["actions"]) - truncated
            for first in range(0, last, length):
                after = min(first + length, last)
                part: dict[str, Any] = {
                    name: values[first:after].copy() for name, values in rows.items()
                }
                closes = truncated and after == last
                part["truncated"][-1] = closes
                final = slice(last, last + closes)
                yield Chunk(
                    run_id=run_id,
                    actor=DEMONSTRATIONS,
                    incarnation=incarnation,
                    stream=0,
                    sequence=next(sequence),
                    weights_version=0,
                    epsilon=0.0,
                    context=rows["frames"][max(first - context, 0) : first],
                    final_frames=rows["frames"][final],
                    final_vectors=rows["vectors"][final],
                    **part,
                )

    def _episodes(self) -> Iterator[dict[str, NDArray[Any]]]:
        """Yields the recorded rows of each episode, by field."""
        for rows in self._dataset.read():
            ends = np.flatnonzero(rows["terminated"] | rows["truncated"]) + 1
            if not ends.size or ends[-1] != len(rows["actions"]):
                raise InputError("a recorded game has no end: record it again.")
            for begin, end in pairwise([0, *ends.tolist()]):
                yield {name: values[begin:end] for name, values in rows.items()}
