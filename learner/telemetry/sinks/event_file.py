"""`EventFile`: a file of TensorBoard events that stays intact even if the disk is full at times.

TensorBoard's own writer has a thread that dies when the disk refuses a write, and takes the process
with it.
"""

import os
import socket
import time
from pathlib import Path
from types import SimpleNamespace

from tensorboard.compat.proto.event_pb2 import Event
from tensorboard.summary.writer.record_writer import RecordWriter

from common.atomic_file import naming
from common.regular_file import no_links


class EventFile:
    """A new event file in ``folder``, which is created if it does not exist.

    TensorBoard reads the files of a folder in the order of their names, so the name begins with the
    time.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        seconds, rest = divmod(time.time_ns(), 10**9)
        whose = f"{socket.gethostname()}.{os.getpid()}"
        name = f"events.out.tfevents.{seconds:010}.{whose}.{rest:09}"
        self._path = folder / name
        self._file = no_links(str(self._path), os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        self._pending = bytearray()
        """Bytes that are not in the file yet."""
        self._records = RecordWriter(SimpleNamespace(write=self._pending.extend))
        self.add(Event(wall_time=time.time(), file_version="brain.Event:2"))

    def add(self, event: Event) -> None:
        """Appends an event; `flush` writes it."""
        self._records.write(event.SerializeToString())

    def flush(self) -> None:
        """Writes all that was added.

        Raises:
            OSError: the disk refuses it; the next call writes the rest.
        """
        with naming(self._path):
            while self._pending:
                del self._pending[: os.write(self._file, self._pending)]

    def close(self) -> None:
        """Writes all that was added, and closes the file even if the disk refuses it."""
        try:
            self.flush()
        finally:
            os.close(self._file)
