"""The start of a run with demonstrations: which of them its replay lacks, and sending these."""

import threading
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from itertools import count
from pathlib import Path

from common.atomic_file import write_atomically
from common.errors import InputError, MessageError
from common.protocol.ack import Ack
from common.protocol.run_keys import DEMONSTRATIONS, RunKeys
from common.run.folder import RunFolder
from common.settings.config import RunConfig
from common.transport.interface import Envelope, Transport
from common.transport.requests import Window
from learner.demonstrations.record import DemonstrationsRecord
from learner.demonstrations.recording import Demonstrations
from replay.interface import Replay

_DEADLINE = 5.0
"""Seconds without a reply after which a chunk is sent again."""
_PAUSE_SECONDS = 0.2
_PATIENCE = 50
"""Number of pauses without a reply after which people are told so."""


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
    False if ``stop`` was set. Raises InputError as `insert` does."""
    keys = RunKeys(folder.name, replay.run_id)
    if (complete := insert(demonstrations, transport, keys, stop, tell)) is None:
        return False
    replay.sync()  # or a power failure could cost steps that count as sent
    write_atomically(folder.demonstrations, complete.encode())
    return True


def insert(
    demonstrations: Demonstrations,
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
    begun, stats = demonstrations.begun, demonstrations.stats
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
        for chunk in demonstrations.chunks(keys.run_id):
            window.send(chunk.encode())
            if not wait(demonstrations.config.stream.window - 1):
                return None
        if not wait(0):
            return None
        told = replace(stats, leaving=True, acked=stats.made, run_id=keys.run_id)
        with closing(transport.publisher(keys.stats("actor", DEMONSTRATIONS))) as publisher:
            publisher.publish(told.encode())
    tell(f"the replay begins with {stats.steps:,} steps of {begun.path}.")
    return replace(begun, complete=True)
