"""`EventFile`: a file of TensorBoard's events that is whole, however often the disk is full.

TensorBoard's own writer has a thread, which dies by what a disk refuses, and its process with it.
"""

import os
import socket
import time
from pathlib import Path
from types import SimpleNamespace

from tensorboard.compat.proto.event_pb2 import Event
from tensorboard.summary.writer.record_writer import RecordWriter

from common.regular_file import no_links


class EventFile:
    """A new file in ``folder``, which is made when it does not exist.

    TensorBoard reads the files of a folder in the order of their names: these follow time.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        seconds, rest = divmod(time.time_ns(), 10**9)
        whose = f"{socket.gethostname()}.{os.getpid()}"
        name = f"events.out.tfevents.{seconds:010}.{whose}.{rest:09}"
        self._file = no_links(str(folder / name), os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        self._pending = bytearray()
        """What is not in the file yet."""
        self._records = RecordWriter(SimpleNamespace(write=self._pending.extend))
        self.add(Event(wall_time=time.time(), file_version="brain.Event:2"))

    def add(self, event: Event) -> None:
        """Append an event; `flush` writes it."""
        self._records.write(event.SerializeToString())

    def flush(self) -> None:
        """Write all that was added.

        Raises:
            OSError: the disk does not take it; the rest follows at the next call.
        """
        while self._pending:
            del self._pending[: os.write(self._file, self._pending)]

    def close(self) -> None:
        """Write all that was added, and end."""
        self.flush()
        os.close(self._file)
