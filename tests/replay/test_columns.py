"""The ring's files: made only where there is room, and closed while threads still use them."""

import os
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from common.errors import InputError
from replay.columns import Columns


def test_files_may_be_closed_while_they_are_synced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    columns, synced, fdatasync = Columns(tmp_path, 40, 0), list[str](), os.fdatasync

    def close_and_sync(file: int) -> None:
        columns.close()
        synced.append(Path(f"/proc/self/fd/{file}").readlink().name)
        fdatasync(file)

    monkeypatch.setattr(os, "fdatasync", close_and_sync)
    columns.sync()
    assert {*synced, "priorities.bin"} == {each.name for each in tmp_path.iterdir()}
    Columns(tmp_path, 40, 0, existing=True).close()  # nothing holds the ring's lock any more


def test_files_of_a_ring_at_work_are_left_as_they_are(tmp_path: Path) -> None:
    """A file that shrinks under a mapping ends the process that reads it."""
    columns = Columns(tmp_path, 40, 0)
    sizes = {each.name: each.stat().st_size for each in tmp_path.iterdir()}
    with pytest.raises(InputError, match="another process uses the replay"):
        Columns(tmp_path, 20, 0)
    assert {each.name: each.stat().st_size for each in tmp_path.iterdir()} == sizes
    columns.close()


def test_files_may_be_closed_while_their_bytes_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    columns, stat = Columns(tmp_path, 40, 0), os.stat
    expected = sum(each.stat().st_blocks * 512 for each in tmp_path.iterdir())

    def close_and_stat(path: Path, **how: bool) -> os.stat_result:
        columns.close()
        return stat(path, **how)

    monkeypatch.setattr(os, "stat", close_and_stat)
    assert columns.file_bytes == expected > 0


def test_rows_are_whole_where_the_system_writes_a_part_at_a_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    columns, pwrite = Columns(tmp_path, 5, 0), os.pwrite
    monkeypatch.setattr(os, "pwrite", lambda file, data, at: pwrite(file, data[:3], at))
    columns.write("rewards", 8, np.arange(1, 5, dtype=np.float32))  # around the end
    assert columns.rows["rewards"].tolist() == [3, 4, 0, 1, 2]
    columns.close()


@pytest.mark.parametrize(("total", "fits"), [(4_096_000, False), (0, True)])
def test_a_file_system_without_a_limit_has_room(
    total: int, fits: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=0, total=total))
    if fits:
        Columns(tmp_path / "replay", 40, 0).close()
    else:
        with pytest.raises(InputError, match="No space left on device"):
            Columns(tmp_path / "replay", 40, 0)
    assert (tmp_path / "replay").exists() == fits
