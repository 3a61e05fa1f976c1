"""Writes a recording game by game, so that it is complete at every moment."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from common.atomic_file import write_atomically
from common.dataset.layout import (
    BOOKKEEPING,
    CAMERA,
    CHUNK_FILES,
    DATA_PATH,
    EPISODES_PATH,
    INFO,
    STATISTICS,
    TASKS,
    VERSION,
    VIDEO_PATH,
    Feature,
    file_of,
    place_of,
)
from common.settings.config import RunConfig

_PANDAS = {
    "index_columns": ["task"],
    "columns": [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": dtype}
        for name, kind, dtype in (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    ],
    "column_indexes": [],
}
"""Tells pandas that the tasks' texts are the index, because LeRobot looks for them there."""
_SLICE = 4_000_000
"""Number of values that are processed at a time: all frames of a game would fill the memory."""
_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


class DatasetWriter:
    """Adds episodes to a new dataset. If it is killed, all added episodes can be read.

    The columns of an episode are written first, and `INFO`, which counts the episode, last.

    Args:
        features: the columns, and the camera's video if there is one.
        robot: the robot's type, as LeRobot calls it.
        rate: rows per second of game time.
    """

    def __init__(
        self,
        folder: Path,
        config: RunConfig,
        features: Mapping[str, Feature],
        robot: str,
        rate: float,
    ) -> None:
        self.folder = folder
        self.rate = rate
        self._config = config
        self._features = {**features, **BOOKKEEPING}
        self._columns = {
            name: feature for name, feature in self._features.items() if feature.dtype != "video"
        }
        self._robot = robot
        self._statistics: dict[str, _Statistics] = {}
        self.episodes = self.steps = 0
        tasks = {"task_index": [0], "task": [self._task]}
        self._write(folder / TASKS, pa.table(tasks), {"pandas": json.dumps(_PANDAS)})

    @property
    def video(self) -> Path:
        """Path at which the video of the next episode must be written."""
        return file_of(self.folder, VIDEO_PATH, self.episodes, video_key=CAMERA)

    @property
    def _task(self) -> str:
        return f"Play {self._config.task}."

    def add(
        self, rows: Mapping[str, NDArray[Any]], pictures: Sequence[NDArray[np.uint8]] = ()
    ) -> None:
        """Adds an episode; its video, if it has one, must be complete at `video`. Raises OSError if
        the episode cannot be written; earlier episodes stay complete.

        Args:
            rows: the columns, ``[T, *shape]`` each.
            pictures: some pictures of the video, ``uint8 [rows, columns, 3]``, for the statistics.
        """
        steps = len(next(iter(rows.values())))
        place, frame = place_of(self.episodes), np.arange(steps)
        columns = {
            **rows,
            "timestamp": frame / self.rate,
            "frame_index": frame,
            "episode_index": np.full(steps, self.episodes),
            "index": self.steps + frame,
            "task_index": np.zeros(steps),
        }
        table = {
            name: _column(columns[name].astype(feature.dtype, copy=False), feature)
            for name, feature in self._columns.items()
        }
        self._write(file_of(self.folder, DATA_PATH, self.episodes), pa.table(table))
        episode = {
            "episode_index": self.episodes,
            "tasks": [self._task],
            "length": steps,
            "dataset_from_index": self.steps,
            "dataset_to_index": self.steps + steps,
            **{f"{of}/{key}": at for of in ("data", "meta/episodes") for key, at in place.items()},
        }
        if CAMERA in self._features:
            times = {"from_timestamp": 0.0, "to_timestamp": steps / self.rate}
            episode |= {f"videos/{CAMERA}/{key}": at for key, at in {**place, **times}.items()}
        for name, feature in self._features.items():
            if feature.dtype == "video":  # per channel, as colours from 0 to 1
                pixels = np.concatenate([picture.reshape(-1, 3, 1, 1) for picture in pictures])
                its = _Statistics.of(pixels, len(pictures), 255.0)
            else:
                its = _Statistics.of(columns[name], steps)
            episode |= {f"stats/{name}/{key}": told for key, told in its.told().items()}
            self._statistics[name] = self._statistics[name] + its if self.episodes else its
        path = file_of(self.folder, EPISODES_PATH, self.episodes)
        self._write(path, pa.table({name: [value] for name, value in episode.items()}))
        self.episodes += 1
        self.steps += steps
        told = {name: its.told() for name, its in self._statistics.items()}
        write_atomically(self.folder / STATISTICS, json.dumps(told).encode())
        write_atomically(self.folder / INFO, json.dumps(self._info(), indent=2).encode())

    def _info(self) -> dict[str, Any]:
        rate = int(self.rate) if self.rate.is_integer() else self.rate
        features = {name: feature._asdict() for name, feature in self._features.items()}
        if CAMERA in features:
            height, width, channels = self._features[CAMERA].shape
            features[CAMERA]["info"] = {
                "video.height": height,
                "video.width": width,
                "video.channels": channels,
                "video.fps": rate,
                "video.codec": "h264",
                "video.pix_fmt": "yuv420p",
                "video.is_depth_map": False,
                "has_audio": False,
            }
        return {
            "codebase_version": VERSION,
            "robot_type": self._robot,
            "total_episodes": self.episodes,
            "total_frames": self.steps,
            "total_tasks": 1,
            "chunks_size": CHUNK_FILES,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 200,
            "fps": rate,
            "splits": {"train": f"0:{self.episodes}"},
            "data_path": DATA_PATH,
            "video_path": VIDEO_PATH if CAMERA in features else None,
            "features": features,
            "ale_robot": asdict(self._config),
        }

    def _write(
        self, path: Path, table: pa.Table, metadata: Mapping[str, str] | None = None
    ) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        content = BytesIO()
        pq.write_table(table.replace_schema_metadata(metadata), content, compression="zstd")
        write_atomically(path, content.getvalue())


def _column(values: NDArray[Any], feature: Feature) -> pa.Array:
    """Returns ``values [T, *shape]`` as numbers, as lists, or as lists of lists."""
    array = pa.array(values.reshape(-1))
    if feature.shape == (1,):
        return array
    if len(feature.shape) == 1:
        return pa.FixedSizeListArray.from_arrays(array, feature.width)
    for size in reversed(feature.shape):
        array = pa.ListArray.from_arrays(np.arange(0, len(array) + 1, size, dtype=np.int32), array)
    return array


@dataclass(frozen=True)
class _Statistics:
    """Minimum, maximum, mean, deviation and quantiles of a column's rows, element by element.

    The quantiles of several episodes are the mean of the episodes' quantiles, weighted by samples,
    as in LeRobot.
    """

    unit: float
    """Value that is reported as 1."""
    samples: int
    rows: int
    sums: NDArray[np.float64]
    """Sum of the rows, sum of their squares, and each quantile times its samples,
    ``[7, *shape]``."""
    least: NDArray[np.float64]
    most: NDArray[np.float64]

    @classmethod
    def of(cls, rows: NDArray[Any], samples: int, unit: float = 1.0) -> Self:
        """Returns the statistics of ``rows [T, *shape]``, which are that many ``samples``: all
        pixels of a picture are one sample."""
        numbers = rows.reshape(len(rows), -1).T
        few = max(_SLICE // len(rows), 1)
        parts = [_figures(numbers[first : first + few]) for first in range(0, len(numbers), few)]
        found = np.concatenate(parts, axis=1).reshape(-1, *(rows.shape[1:] or (1,)))
        sums = np.concatenate((found[:2], samples * found[4:]))
        return cls(unit, samples, len(rows), sums, least=found[2], most=found[3])

    def __add__(self, other: Self) -> Self:
        return replace(
            self,
            samples=self.samples + other.samples,
            rows=self.rows + other.rows,
            sums=self.sums + other.sums,
            least=np.minimum(self.least, other.least),
            most=np.maximum(self.most, other.most),
        )

    def told(self) -> dict[str, Any]:
        mean, square = self.sums[:2] / self.rows
        deviation = np.sqrt(np.maximum(square - np.square(mean), 0.0))
        told = {"min": self.least, "max": self.most, "mean": mean, "std": deviation}
        told |= zip(_QUANTILES, self.sums[2:] / self.samples, strict=True)
        scaled = {key: (value / self.unit).tolist() for key, value in told.items()}
        return {**scaled, "count": [self.samples]}


def _figures(numbers: NDArray[Any]) -> NDArray[np.float64]:
    """Returns sum, sum of squares, minimum, maximum and quantiles of each row of
    ``numbers [N, T]``, as ``[9, N]``. A quantile is the smallest value that the given share of the
    row does not exceed."""
    # The stable sort counts short integers; `np.quantile` takes seconds for the frames of a game.
    ordered = np.sort(np.ascontiguousarray(numbers), kind="stable")
    total = ordered.sum(axis=1, dtype=np.float64)
    squares = np.einsum("nt,nt->n", ordered, ordered, dtype=np.float64)
    places = [math.ceil(share * ordered.shape[1]) - 1 for share in _QUANTILES.values()]
    return np.vstack((total, squares, ordered[:, [0, -1, *places]].T))
