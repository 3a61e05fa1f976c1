"""Recordings that are none, of other versions, damaged, or that claim what they have not."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from common.dataset import reader
from common.dataset.layout import DATA_PATH, INFO, MAX_EPISODE_STEPS, file_of
from common.dataset.reader import Dataset
from common.errors import InputError
from tests.actors.numbered_env import GAME_OVER, GOES_ON
from tests.recordings import record


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two games of three steps."""
    record(tmp_path / "d", [GOES_ON, GOES_ON, GAME_OVER], 6)
    return tmp_path / "d"


def test_rows_are_read_game_by_game(folder: Path) -> None:
    dataset = Dataset(folder)
    assert dataset.episodes == 2
    assert [rows["terminated"].tolist() for rows in dataset.read()] == [[False, False, True]] * 2


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no whole game"):
        Dataset(tmp_path / "nothing")
    (tmp_path / "meta").mkdir()
    (tmp_path / INFO).write_text('{"codebase_version": "v3.0", "total_episodes": 1}')
    with pytest.raises(InputError, match="was not written by `ale-robot record`"):
        Dataset(tmp_path)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"codebase_version": "v2.1"}, "has version 'v2.1' of LeRobot's format"),
        ({"total_episodes": 0}, "total_episodes is 0: choose 1 or more"),
        ({"total_episodes": 10**9}, "choose at most 100000"),
        ({"total_episodes": "2"}, "which is not a whole number"),
        ({"ale_robot": {"game": "pong"}}, "missing or unknown field|is not a"),
        ({"ale_robot": []}, "ale_robot should be a table"),
    ],
)
def test_what_is_said_of_it_is_checked(folder: Path, change: dict[str, Any], reason: str) -> None:
    path = folder / INFO
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InputError, match=reason):
        Dataset(folder)


def without(name: str) -> Callable[[pa.Table], pa.Table]:
    return lambda table: table.drop_columns([name])


def put(name: str, values: list[Any], kind: pa.DataType) -> Callable[[pa.Table], pa.Table]:
    return lambda table: table.drop_columns([name]).append_column(name, pa.array(values, kind))


def within_struct(name: str) -> Callable[[pa.Table], pa.Table]:
    """Column ``next.NAME`` as the field NAME of a column ``next``, which has the same path."""

    def change(table: pa.Table) -> pa.Table:
        [values] = table[f"next.{name}"].chunks
        inner = pa.StructArray.from_arrays([values], [name])
        return table.drop_columns([f"next.{name}"]).append_column("next", inner)

    return change


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (without("action"), "it has no action"),
        (within_struct("elapsed"), "it has no next.elapsed"),
        (lambda table: table.slice(0, 0), "it has 0 rows"),
        (put("action", [1, None, 2], pa.uint8()), "action has gaps"),
        (put("action", [1, 2, 70_000], pa.int64()), "action has int64 instead of uint8"),
        (
            put("next.reward", ["a", "b", "c"], pa.string()),
            "next.reward has string instead of float32",
        ),
        (
            put("observation.frame", [[[0] * 84] * 83] * 3, pa.list_(pa.list_(pa.uint8()))),
            "observation.frame has 20916 values in 3 rows",
        ),
        (
            put(
                "observation.frame", [[[0] * 7056 * 3], [[]], [[]]], pa.list_(pa.list_(pa.uint8()))
            ),
            "observation.frame",
        ),
        (
            lambda table: pa.concat_tables([table.drop_columns(["observation.frame"])] * 40_000),
            f"it has {3 * 40_000} rows",
        ),
    ],
)
def test_columns_are_what_they_should_be(
    folder: Path, change: Callable[[pa.Table], pa.Table], reason: str
) -> None:
    path = file_of(folder, DATA_PATH, 0)
    pq.write_table(change(pq.read_table(path)), path)
    assert MAX_EPISODE_STEPS < 3 * 40_000
    with pytest.raises(InputError, match=reason) as refused:
        list(Dataset(folder).read())
    assert "is damaged" in str(refused.value)


def test_a_small_file_that_holds_a_great_deal_is_not_unpacked(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reader, "_MAX_UNPACKED_BYTES", 1_000)
    with pytest.raises(InputError, match=r"it has \d+ bytes when unpacked"):
        list(Dataset(folder).read())


def test_a_file_that_is_missing_or_cut_off_is_told(folder: Path) -> None:
    path = file_of(folder, DATA_PATH, 1)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match=r"file-001.parquet is damaged"):
        list(Dataset(folder).read())
    path.unlink()
    with pytest.raises(InputError, match=r"file-001.parquet is damaged .*No such file"):
        list(Dataset(folder).read())
