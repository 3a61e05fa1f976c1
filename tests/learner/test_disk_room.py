"""A full disk pauses training, tells why, and lets it continue."""

import shutil
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from learner.disk_room import DiskRoom


class Disk:
    """A disk with so many bytes free each time it is asked; the last number stays."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *free: int) -> None:
        self._free = list(free)
        self.asked: list[Path] = []
        monkeypatch.setattr(shutil, "disk_usage", self._usage)

    def _usage(self, path: Path) -> SimpleNamespace:
        self.asked.append(path)
        return SimpleNamespace(free=self._free.pop(0) if len(self._free) > 1 else self._free[0])


@pytest.fixture
def checkpoint(tmp_path: Path) -> Path:
    """A checkpoint of a MiB; two more must fit."""
    path = tmp_path / "checkpoint.safetensors"
    path.write_bytes(bytes(2**20))
    return path


class Stop(threading.Event):
    """Never waits; set at the third wait."""

    waits = 0

    def wait(self, timeout: float | None = None) -> bool:
        self.waits += 1
        if self.waits == 3:
            self.set()
        return self.is_set()


def test_where_there_is_room_nothing_is_said(
    checkpoint: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = Disk(monkeypatch, 2 * 2**20)
    said: list[str] = []
    DiskRoom(checkpoint, said.append, threading.Event()).wait()
    assert (said, disk.asked) == ([], [checkpoint.parent])


def test_a_full_disk_is_waited_for(checkpoint: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Disk(monkeypatch, 2 * 2**20 - 1, 0, 2 * 2**20)
    said: list[str] = []
    stop = Stop()
    DiskRoom(checkpoint, said.append, stop).wait()
    assert stop.waits == 1
    assert said == [
        f"WARNING: the disk of {checkpoint.parent} is full: training waits until 2 MiB of it are "
        "free.",
        "There is room on the disk again: training continues.",
    ]


def test_a_stop_ends_the_wait(checkpoint: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Disk(monkeypatch, 0)
    said: list[str] = []
    stop = Stop()
    DiskRoom(checkpoint, said.append, stop).wait()
    assert stop.waits == 3
    assert len(said) == 1
