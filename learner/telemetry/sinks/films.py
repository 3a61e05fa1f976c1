"""``--films``: a film of the warm-up and of each epoch's network, made in a process of its own."""

import logging
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from common.process.supervisor import Child
from common.run.epochs import EpochRow, EpochTable
from common.run.folder import RunFolder, epoch_name, kept_networks
from learner.evaluation.snapshots import Snapshots
from learner.telemetry.sinks.sink import Sink
from learner.telemetry.snapshot import Snapshot

_log = logging.getLogger(__name__)


class _Epoch(NamedTuple):
    number: int
    """Number of the epoch; 0 for the warm-up."""
    agent_steps: int
    """Agent steps at its end."""


@dataclass
class FilmsSink(Sink):
    """Makes films in the run's folder, named like the snapshots, which the run must keep.

    Films are made one at a time, at low priority. If epochs pass faster than films are made, epochs
    are left out; so is a film that the run's end interrupts. `ale-robot film` makes them
    later. A resumed run starts with the film of its newest epoch. The warm-up, which is random play
    in a run without --initial, is epoch 0.
    """

    folder: RunFolder
    seconds: float
    """Seconds of play in each film."""
    epsilon: float
    """Share of random actions in the warm-up."""
    module: str = "viewer"
    """Module that is run to make a film."""
    others: Sequence[Sink] = ()
    """Sinks that receive each finished film."""

    period = 1.0

    def __post_init__(self) -> None:
        self._making = self.folder.films / "making"
        self._snapshots = Snapshots(self.folder.snapshots)
        self._next: _Epoch | None = None
        self._epoch = _Epoch(0, 0)
        self._child: Child | None = None
        """The process that films `_epoch`."""

    def start(self, resumed_at: int | None) -> None:
        """Queues the newest epoch, at the checkpoint's agent steps, if it has no film yet."""
        shutil.rmtree(self._making, ignore_errors=True)
        newest = max(kept_networks(self.folder.snapshots), default=0)
        rows = EpochTable(self.folder.epochs).rows()
        if newest:
            epoch = _Epoch(newest, resumed_at or 0)
        elif [row.epoch for row in rows] == [0]:
            epoch = _Epoch(0, rows[0].steps)
        else:  # the warm-up is not over, or later epochs have gone by without a film
            return
        if not self._file(epoch.number).exists():
            self._next = epoch

    def phase(self, row: EpochRow, agent_steps: int) -> None:
        if row.phase != "test":
            self._next = _Epoch(row.epoch, agent_steps)

    def write(self, snapshot: Snapshot) -> None:
        """Starts the next film, once the previous one has ended."""
        if self._child is not None and self._child.poll() is None:
            return
        with self._in_spite_of_the_disk():
            if self._child is not None:
                ended, self._child = self._child, None
                self._end_film(ended)
            if self._next is not None:
                self._epoch, self._next = self._next, None
                self._child = self._begin_film()

    def close(self) -> None:
        """Interrupts the film that is being made, and leaves no empty folder."""
        with self._in_spite_of_the_disk():
            if self._child is not None and self._child.poll() is None:
                self._child.kill()  # its film is not kept, and a clean exit would take seconds
                self._child.end()
                _log.warning(
                    "the film of epoch %d was interrupted: make one by `ale-robot film %s`",
                    self._epoch.number,
                    self.folder.path,
                )
            elif self._child is not None:
                self._end_film(self._child)
        shutil.rmtree(self._making, ignore_errors=True)
        with suppress(OSError):  # there are films in it, or it was never made
            self.folder.films.rmdir()

    @contextmanager
    def _in_spite_of_the_disk(self) -> Iterator[None]:
        """Turns errors of the disk into warnings: a run is worth more than its films."""
        try:
            yield
        except OSError as error:  # such as a full disk
            _log.warning("there is no film of epoch %d: %s", self._epoch.number, error)

    def _begin_film(self) -> Child:
        self._making.mkdir(parents=True, exist_ok=True)
        self._video = self._making / self._file(self._epoch.number).name
        return Child(
            *(self.module, "film", *self._policy(), "--video", str(self._video)),
            *("--seconds", f"{self.seconds:g}"),
            leash=True,
            low_priority=True,
            log=self.folder.logs / "films.log",
        )

    def _policy(self) -> list[str]:
        """Returns the network that plays, and its flags."""
        if self._epoch.number:
            return [str(self._snapshots.file(self._epoch.number))]
        if self.folder.initial.exists():
            return [str(self.folder.initial), "--epsilon", f"{self.epsilon:g}"]
        # Only the settings in the checkpoint count: its network may have learned already.
        return [str(self.folder.checkpoint), "--epsilon", "1"]

    def _end_film(self, child: Child) -> None:
        number, agent_steps = self._epoch
        if child.returncode:
            _log.warning("there is no film of epoch %d: %s", number, child.last_line())
            return
        film = self._video.replace(self._file(number))
        for sink in self.others:
            try:
                sink.filmed(film, agent_steps)
            except Exception as error:  # such as a film that cannot be read
                _log.warning("the film of epoch %d is not shown: %s", number, error)

    def _file(self, epoch: int) -> Path:
        return self.folder.films / f"{epoch_name(epoch)}.mp4"
