"""Power failures, by replaying prefixes of the recorded writes to a disk that may lose any of them
that was not synced, as ALICE does (Pillai et al., OSDI 2014)."""

import os
import random
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from replay.batch import Batch
from replay.replay_buffer import ReplayBuffer
from tests.replay.replay_reference import GOES_ON, TERMINATES, TRUNCATES, Actor, make_config
from tests.replay.test_replay_buffer import check_batch

CONFIG = make_config(capacity=60, batch_size=1_000)
CRASHES = 25


class Disk:
    """Records what is written below ``folder``, and what a power failure may leave of it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.log: list[tuple[str, str, Any]] = []
        """Each write: what happened, to which file, and its content."""

    def _name(self, file: int) -> str | None:
        path = Path(os.readlink(f"/proc/self/fd/{file}"))
        inside = path.is_relative_to(self._folder)
        return str(path.relative_to(self._folder)) if inside else None

    @contextmanager
    def recording(self, patch: pytest.MonkeyPatch) -> Iterator[None]:
        real: dict[str, Callable[..., Any]] = {
            name: getattr(os, name) for name in ("pwrite", "write", "fsync", "fdatasync")
        }

        def pwrite(file: int, data: bytes, offset: int) -> Any:
            self.log.append(("write", str(self._name(file)), (offset, bytes(data))))
            return real["pwrite"](file, data, offset)

        def write(file: int, data: bytes) -> Any:
            if (name := self._name(file)) is not None:
                self.log.append(("write", name, (os.fstat(file).st_size, bytes(data))))
            return real["write"](file, data)

        def sync(file: int) -> None:
            if (name := self._name(file)) is not None:
                # A new file is written through Python's own buffer, and is whole when synced.
                whole = Path(self._folder, name).read_bytes() if name.endswith(".tmp") else None
                self.log.append(("sync", name, whole))

        renamed = Path.replace

        def replace(path: Path, target: Path) -> Path:
            if path.is_relative_to(self._folder):
                names = (str(each.relative_to(self._folder)) for each in (path, target))
                self.log.append(("rename", next(names), next(names)))
            return renamed(path, target)

        with patch.context() as patched:
            patched.setattr(os, "pwrite", pwrite)
            patched.setattr(os, "write", write)
            patched.setattr(os, "fsync", sync)
            patched.setattr(os, "fdatasync", sync)
            patched.setattr(Path, "replace", replace)
            yield

    def crash(self, until: int, before: Path, after: Path, dice: random.Random) -> None:
        """Leave in ``after`` what may be left of ``before`` and the first ``until`` writes."""
        shutil.copytree(before, after)
        synced: dict[str, int] = {}
        for at, (what, name, _) in enumerate(self.log[:until]):
            if what == "sync":
                synced[name] = at
        for at, (what, name, content) in enumerate(self.log[:until]):
            path = after / name
            folder_synced = synced.get(".", -1) > at
            if what == "sync" and content is not None:
                path.write_bytes(content)
            elif what == "rename" and (folder_synced or dice.random() < 0.5):
                path.replace(after / content)
            elif what == "write" and (synced.get(name, -1) > at or dice.random() < 0.7):
                offset, data = content
                with path.open("r+b") as file:
                    file.seek(offset)  # zeros before it, where earlier ones are lost
                    file.write(data)


def ids_in(batch: Batch | None) -> set[int]:
    """Ids of all steps that can be drawn, for a minibatch is so large that it has them all."""
    return set() if batch is None else set(batch.ids.tolist())


def test_a_power_failure_costs_only_what_was_not_synced_and_alters_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("replay.store._SPARE_BYTES", 900)  # the journal is rewritten on the way
    monkeypatch.setattr("replay.chunk_index.MAX_STATISTICS", 1)
    folder, start = tmp_path / "replay", tmp_path / "start"
    actor, rng = Actor("0", 4), np.random.default_rng(0)
    buffer = ReplayBuffer(CONFIG, folder)
    buffer.insert(actor.live([GOES_ON] * 4, rng))
    shutil.copytree(folder, start)
    disk, steps = Disk(folder), 4
    durable = [(0, 0, ids_in(buffer.sample(0, 0.0)))]
    """Writes, agent steps and drawable steps at each sync."""
    after = []
    """Writes and drawable steps after each insert."""
    with disk.recording(monkeypatch):
        for number in range(40):
            end = (GOES_ON, TERMINATES, GOES_ON, TRUNCATES)[number % 4]
            buffer.insert(actor.live([GOES_ON, GOES_ON, GOES_ON, end], rng))
            steps += 4
            after.append((len(disk.log), ids_in(buffer.sample(0, 0.0))))
            if number % 9 == 8:
                buffer.sync()
                durable.append((len(disk.log), steps, after[-1][1]))
    buffer.close()
    assert any(what == "rename" for what, *_ in disk.log)

    found = []
    for seed in range(CRASHES):
        dice = random.Random(seed)
        until = dice.randrange(len(disk.log) + 1)
        left = tmp_path / f"crash-{seed}"
        disk.crash(until, start, left, dice)
        buffer = ReplayBuffer(CONFIG, left)
        progress = buffer.progress(0)
        _, told, synced = [each for each in durable if each[0] <= until][-1]
        assert progress.agent_steps >= told
        batch = buffer.sample(0, 0.0)
        assert (batch is not None) == (progress.samplable > 0)
        if batch is not None:
            check_batch(batch, [actor], CONFIG)  # every pixel, reward and discount
        # What was synced is there, but for what the insert under way has evicted.
        lasting = next((ids for at, ids in after if at >= until), after[-1][1])
        assert synced & lasting <= ids_in(batch)
        assert buffer.insert(Actor("1", 4, 0, 1_000_000).live([GOES_ON], rng)).status == "stored"
        buffer.close()
        shutil.rmtree(left)
        found.append(progress.samplable)
    assert len(set(found)) > 3
