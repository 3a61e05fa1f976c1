"""An actor that records its chunks and their acknowledgements independently of its counters.

python -m benchmarks.chaos.witness RECORD ACTOR'S-ARGUMENTS

A chunk is recorded before it is first sent, and again when its acknowledgement has come. Each
line is one write to a file opened for appending, so a killed actor loses at most its last line. An
acknowledged chunk may then count as unacknowledged, never the other way round.
"""

if __name__ == "__main__":
    from common.process.lifeline import leave_at_interrupt

    leave_at_interrupt()

import hashlib
import os
import sys
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import numpy as np

from common.errors import MessageError
from common.process.program_end import exit_on_input_error
from common.process.threads import guarded
from common.protocol.ack import Ack
from common.protocol.chunk import Chunk
from common.transport.interface import Envelope, Requester
from common.transport.requests import Window

RECORDED = ("frames", "actions", "rewards", "elapsed")
"""Fields by which the audit recognises a step."""


def digest(field_of: Callable[[str], Any], final_frames: Any) -> str:
    """Returns the SHA-256 of steps and of the frames after steps that cut a game.

    ``field_of`` returns the steps' arrays by name.
    """
    found = hashlib.sha256()
    for fields in (*map(field_of, RECORDED), final_frames):
        found.update(np.ascontiguousarray(fields).tobytes())
    return found.hexdigest()


def recorded(file: int) -> type[Window]:
    """Returns a `Window` that records what it sends and what is acknowledged to ``file``."""

    class Recorded(Window):
        def send(self, payload: bytes) -> None:
            chunk = Chunk.decode(payload)
            os.write(file, line("made", chunk))
            super().send(payload)

        def __init__(
            self, requester: Requester, settled: Callable[[Envelope | MessageError], None]
        ) -> None:
            super().__init__(_Witness(requester, file), settled)

    return Recorded


class _Witness:
    """A `Requester` that records each acknowledgement before its caller gets it."""

    def __init__(self, requester: Requester, file: int) -> None:
        self._requester = requester
        self._file = file
        self.close = requester.close

    @property
    def has_server(self) -> bool:
        return self._requester.has_server

    def request(self, payload: bytes) -> Future[Envelope]:
        def record(future: Future[Envelope]) -> None:
            if future.exception() is None:
                ack = Ack.decode(future.result().payload)
                if ack.status in ("stored", "duplicate"):
                    chunk = Chunk.decode(payload)
                    os.write(self._file, line("acknowledged", chunk))

        future = self._requester.request(payload)
        future.add_done_callback(guarded("witness", record))
        return future


def line(what: str, chunk: Chunk) -> bytes:
    """Returns the record of an event of a chunk: its digest, and the numbers of rows of its steps
    and of its last frames."""
    finals = chunk.final_frames
    found = digest(lambda name: getattr(chunk, name), finals)
    return f"{what} {found} {len(chunk)} {len(finals)}\n".encode()


def main() -> int:
    from actors import __main__ as actor
    from actors.stream import insert_client

    how = os.O_WRONLY | os.O_APPEND | os.O_CREAT
    vars(insert_client)["Window"] = recorded(os.open(sys.argv.pop(1), how))
    return actor.main()


if __name__ == "__main__":
    exit_on_input_error(main)
