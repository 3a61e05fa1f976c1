"""The layout of a recording on disk: a LeRobot dataset, version v3.0, with one file per game.

One row is one step of an environment, as an actor would send it. So every field of `STEP_FIELDS` is
a column, stored without loss. Further columns are for people and robot policies: the camera's
video, the keys, the joints. An episode is a whole game, or the beginning of one that was cut short.
"""

from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from annotated_types import Ge, Le

from common.protocol.step_fields import STEP_FIELDS

VERSION = "v3.0"
INFO = "meta/info.json"
STATISTICS = "meta/stats.json"
TASKS = "meta/tasks.parquet"
CHUNK_FILES = 1_000
"""Files per folder."""
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
EPISODES_PATH = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
MAX_EPISODES = 100_000
MAX_EPISODE_STEPS = 110_000
"""Maximum number of steps of a game; at 15 per second, two hours."""

CAMERA = "observation.images.camera"
COLUMNS = {
    **{name: f"next.{name}" for name in STEP_FIELDS},
    "frames": "observation.frame",
    "valid": "observation.valid",
    "vectors": "observation.vector",
    "actions": "action",
    "rewards": "next.reward",
}
"""Column of each field of `STEP_FIELDS`; the vector's column exists only if there is a vector."""


class Feature(NamedTuple):
    """A column, or a video."""

    dtype: str
    """NumPy's name, or "video"."""
    shape: tuple[int, ...]
    names: list[str] | None = None

    @property
    def width(self) -> int:
        """Number of values in one row."""
        return prod(self.shape)


def step_features(vector_width: int) -> dict[str, Feature]:
    """Returns the columns that hold `STEP_FIELDS`, by column name."""
    sizes = {"T": 1, "P": vector_width}
    return {
        COLUMNS[name]: Feature(str(field.dtype), field.array.shape_for(sizes)[1:] or (1,))
        for name, field in STEP_FIELDS.items()
        if name != "vectors" or vector_width
    }


BOOKKEEPING = {
    "timestamp": Feature("float32", (1,)),
    "frame_index": Feature("int64", (1,)),
    "episode_index": Feature("int64", (1,)),
    "index": Feature("int64", (1,)),
    "task_index": Feature("int64", (1,)),
}
"""Columns that every LeRobot dataset has."""


@dataclass(frozen=True)
class Info:
    """The part of `INFO` that a reader uses."""

    codebase_version: str
    total_episodes: Annotated[int, Ge(1), Le(MAX_EPISODES)]
    ale_robot: dict[str, Any]
    """The `RunConfig` under which the games were played."""


def file_of(folder: Path, pattern: str, episode: int, **more: str) -> Path:
    """Returns the file of an episode, which holds nothing else."""
    return folder / pattern.format(**place_of(episode), **more)


def place_of(episode: int) -> dict[str, int]:
    """Returns the values of the patterns' fields for an episode's files."""
    chunk_index, file_index = divmod(episode, CHUNK_FILES)
    return {"chunk_index": chunk_index, "file_index": file_index}
