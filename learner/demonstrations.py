"""Recorded games with which a run's replay begins.

They are sent as an actor named `DEMONSTRATIONS` would send them: as ordinary chunks in ordinary
requests, which are checked and counted like any other. So it does not matter whether the replay
is in this process or in one of its own.

Their steps are steps of the run: they shorten the warm-up, ε falls as if they had been played now,
and the limiter holds actors back until the learner has made the updates that they call for. Their
games are not counted, because the scores of a run are those of its own play.

A recording always yields the same chunks, down to the incarnation of their sender. So the replay
recognises those that it has, and an interrupted start can be repeated without harm.
"""

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from itertools import count, pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import StringConstraints

from common.atomic_file import write_atomically
from common.checked import Count, build
from common.errors import InputError, MessageError
from common.process.extras import extra_for
from common.protocol.ack import Ack
from common.protocol.actor_stats import ActorStats
from common.protocol.chunk import Chunk
from common.protocol.run_keys import DEMONSTRATIONS, RunKeys
from common.regular_file import read_file
from common.run.folder import RunFolder
from common.settings.config import RunConfig
from common.settings.fit import VECTOR_PARTS, VECTOR_SETTINGS, as_flag
from common.settings.stored_config import flat
from common.transport.interface import Envelope, Transport
from common.transport.requests import Window
from replay.interface import Replay

_ALIKE = (
    "game",
    "play.frame_stack",
    "play.frame_skip",
    "play.minimal_actions",
    *VECTOR_SETTINGS,
    "learning.clip_rewards",
)
"""Settings that must be equal, because states, actions or rewards depend on them."""
_DEADLINE = 5.0
"""Seconds without a reply after which a chunk is sent again."""
_PAUSE_SECONDS = 0.2
_PATIENCE = 50
"""Number of pauses without a reply after which people are told so."""


@dataclass(frozen=True)
class DemonstrationsRecord:
    """The record of a run's demonstrations that is kept in its folder."""

    path: Annotated[str, StringConstraints(max_length=4_096)]  # as on Linux
    fingerprint: str
    """Hash of the recording, see `common.dataset.reader.Dataset`."""
    steps: Count
    complete: bool = False
    """Whether the replay has all of them."""

    @classmethod
    def of(cls, folder: RunFolder) -> "DemonstrationsRecord | None":
        """Returns the record in ``folder``; None for a run without demonstrations.

        Raises:
            InputError: the file is damaged.
        """
        try:
            return build(cls, json.loads(read_file(folder.demonstrations)))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, RecursionError) as error:
            raise InputError(
                f"{folder.demonstrations} is damaged ({error}): repair or restore it."
            ) from None

    def encode(self) -> bytes:
        """Returns the record as JSON, which `of` reads."""
        return json.dumps(asdict(self)).encode()


class Demonstrations:
    """A recording, turned into chunks of a run."""

    def __init__(self, path: Path, config: RunConfig) -> None:
        """Reads the whole recording, and compares it with the run's ``config``.

        Raises:
            InputError: the recording is damaged, was played under other settings than the run's,
                or does not fit into its replay; or pyarrow is missing.
        """
        with extra_for("--demonstrations", "record"):
            from common.dataset.reader import Dataset
        self._config = config
        self._dataset = Dataset(path)
        self._refuse_others(path)
        self._stats = stats = self._counted(path)
        if not stats.steps:
            raise InputError(f"{path} has no step to learn from: record whole games.")
        waits, discount = stats.decisions > stats.steps, self._dataset.config.learning.discount
        if waits and discount != config.learning.discount:
            raise InputError(
                f"the rewards in {path} were discounted with another --learning.discount: give "
                f"the run {discount:g}, or record others."
            )
        if stats.steps > config.replay.capacity:
            raise InputError(
                f"{path} has {stats.steps:,} steps, too many for the replay: raise "
                "--replay.capacity, or record fewer."
            )
        self.begun = DemonstrationsRecord(
            str(path.resolve()), self._dataset.fingerprint, stats.steps
        )
        stats.incarnation = int(self.begun.fingerprint[:15], 16)

    def _refuse_others(self, path: Path) -> None:
        both = self._dataset.config, self._config
        recorded, wanted = (flat(each) | {"game": each.task} for each in both)
        names = [name for name in _ALIKE if recorded[name] != wanted[name]]
        if not recorded["play.vector"]:  # then its contents mean nothing
            names = [name for name in names if name not in VECTOR_PARTS]
        unequal = [f"{name} {recorded[name]} instead of {wanted[name]}" for name in names]
        widths = self._dataset.config.vector_width, self._config.vector_width
        if not unequal and widths[0] != widths[1]:
            names, unequal = ["play.robot"], ["vectors of {} numbers instead of {}".format(*widths)]
        if unequal:
            if recorded["game"] != self._dataset.config.game or wanted["game"] != self._config.game:
                names = ["env", *names]  # one of them has no Atari game
            flags = " ".join(as_flag(name, self._dataset.config) for name in names)
            raise InputError(
                f"the demonstrations in {path} have {', '.join(unequal)}: give the run {flags}, or "
                "record others."
            )

    def _counted(self, path: Path) -> ActorStats:
        """Returns the counters of the actor that sends all chunks, each of which it checks."""
        stats = ActorStats(DEMONSTRATIONS, "actor", epsilon=0.0)
        for chunk in self._chunks("", 0):
            stats.made += 1
            stats.steps += len(chunk)
            stats.valid += int(np.count_nonzero(chunk.valid))
            stats.matched += int(np.count_nonzero(chunk.matched))
            stats.decisions += int(chunk.elapsed.sum())
            try:
                Chunk.decode(chunk.encode())
            except MessageError as error:
                raise InputError(f"{path} is damaged ({error}): name another recording.") from None
            if (chunk.actions >= self._config.action_count).any():
                raise InputError(
                    f"{path} has actions that this run does not have: record with the same "
                    "--play.minimal-actions."
                )
        return stats

    def _chunks(self, run_id: str, incarnation: int) -> Iterator[Chunk]:
        """Yields the steps, episode by episode.

        A recording has the state before each step, but not the state after the last one. So an
        episode that was cut short loses its last step, and the step before it is truncated.
        """
        length, context = self._config.stream.chunk_steps, self._config.play.frame_stack - 1
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

    def insert(
        self,
        transport: Transport,
        keys: RunKeys,
        stop: threading.Event,
        tell: Callable[[str], None],
    ) -> DemonstrationsRecord | None:
        """Sends all chunks to the run's replay; returns the complete record, None if ``stop`` was
        set.

        Raises:
            InputError: the replay refuses a chunk, or the recording changed while it was read.
        """
        refusals: list[str] = []

        def settle(outcome: Envelope | MessageError) -> None:
            try:
                if isinstance(outcome, MessageError):
                    raise outcome
                if Ack.decode(outcome.payload).status == "refused":
                    refusals.append("it serves another run")
            except MessageError as error:  # a refusal, or a malformed reply
                refusals.append(str(error))

        requester = transport.requester(keys.insert(DEMONSTRATIONS), _DEADLINE)
        presence = transport.announce(keys.live("actor", DEMONSTRATIONS))
        window = Window(requester, settle)

        def wait(most: int) -> bool:
            for pauses in count(1):
                if stop.is_set() or refusals or window.wait(most, _PAUSE_SECONDS):
                    break
                if pauses == _PATIENCE:
                    tell("the replay does not answer; the demonstrations wait for it.")
            if refusals:
                raise InputError(f"the replay refused a demonstration: {refusals[0]}.")
            return not stop.is_set()

        with closing(requester), closing(presence):
            for chunk in self._chunks(keys.run_id, self._stats.incarnation):
                window.send(chunk.encode())
                if not wait(self._config.stream.window - 1):
                    return None
            if not wait(0):
                return None
            if self._dataset.fingerprint != self.begun.fingerprint:
                raise InputError(
                    f"{self.begun.path} was changed while it was read: begin a new run with it."
                )
            told = replace(self._stats, leaving=True, acked=self._stats.made, run_id=keys.run_id)
            with closing(transport.publisher(keys.stats("actor", DEMONSTRATIONS))) as publisher:
                publisher.publish(told.encode())
        tell(f"the replay begins with {self._stats.steps:,} steps of {self.begun.path}.")
        return replace(self.begun, complete=True)


def begin_with(
    given: Path | None, config: RunConfig, folder: RunFolder, *, resume: bool
) -> Demonstrations | None:
    """Returns the demonstrations that still have to be sent; None if there are none.

    A run that was interrupted while it sent them sends them again. A run whose replay has them all
    does not read them again.

    Args:
        given: the folder that the user names.

    Raises:
        InputError: the recording cannot be used, or the run did not begin with it.
    """
    begun = DemonstrationsRecord.of(folder) if resume else None
    path = given
    if begun is not None:
        path = (given or Path(begun.path)).resolve()
        if begun.complete and path == Path(begun.path):
            return None
    if path is None:
        return None
    found = Demonstrations(path, config)
    other = begun is not None and begun.fingerprint != found.begun.fingerprint
    if other or (begun is None and resume and folder.has_begun):
        raise InputError(
            f"the run in {folder.path} did not begin with the demonstrations in {path}: omit "
            "--demonstrations, or name another run."
        )
    return None if begun is not None and begun.complete else found


def insert_all(
    demonstrations: Demonstrations,
    transport: Transport,
    replay: Replay,
    folder: RunFolder,
    stop: threading.Event,
    tell: Callable[[str], None],
) -> bool:
    """Sends all chunks to the ``replay``, and records in the run's folder that it has them; returns
    False if ``stop`` was set. Raises InputError as `Demonstrations.insert` does."""
    keys = RunKeys(folder.name, replay.run_id)
    if (complete := demonstrations.insert(transport, keys, stop, tell)) is None:
        return False
    replay.sync()  # or a power failure could cost steps that count as sent
    write_atomically(folder.demonstrations, complete.encode())
    return True
