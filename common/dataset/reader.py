"""Reads a recording, and trusts nothing in it."""

import hashlib
import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from common.checked import build
from common.dataset.layout import (
    COLUMNS,
    DATA_PATH,
    INFO,
    MAX_EPISODE_STEPS,
    VERSION,
    Info,
    file_of,
    step_features,
)
from common.errors import InputError
from common.protocol.step_fields import STEP_FIELDS
from common.regular_file import read_file
from common.run.rules import check_config
from common.settings.config import RunConfig
from common.settings.stored_config import from_mapping

_MAX_INFO_BYTES = 2**20
_MAX_FILE_BYTES = 2**31
_MAX_UNPACKED_BYTES = 2**31
Rows = dict[str, NDArray[Any]]
"""Rows of an episode by the names of `STEP_FIELDS`, ``[T, *shape]`` each."""


class Dataset:
    """A recording that `common.dataset.writer` made; reads its fields of `STEP_FIELDS`."""

    def __init__(self, folder: Path) -> None:
        """Reads the recording's description. Raises InputError if ``folder`` is not a recording, or
        is damaged."""
        self._folder = folder
        path = folder / INFO
        try:
            content = read_file(path, _MAX_INFO_BYTES)
            told = json.loads(content)
            info = build(Info, {name: told[name] for name in Info.__annotations__})
        except (FileNotFoundError, NotADirectoryError):
            raise InputError(
                f"{folder} holds no whole game ({INFO} is missing): name the folder of a "
                "recording by `ale-robot record`."
            ) from None
        except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
            raise InputError(
                f"{path} was not written by `ale-robot record` ({error}): name another recording."
            ) from None
        if info.codebase_version != VERSION:
            raise InputError(
                f"{folder} has version {info.codebase_version!r} of LeRobot's format: name a "
                f"recording of version {VERSION}."
            )
        self.config = from_mapping(RunConfig, info.ale_robot, str(path), fill=True)
        """The settings under which the games were played."""
        check_config(self.config)
        self.episodes = info.total_episodes
        self._info = content
        self.fingerprint = ""
        """SHA-256 of the recording, in hexadecimal digits, once `read` has come to its end."""

    def read(self) -> Iterator[Rows]:
        """Yields the rows of each episode, in order. Raises InputError if a file is missing or
        damaged."""
        digest = hashlib.sha256(self._info)
        for episode in range(self.episodes):
            path = file_of(self._folder, DATA_PATH, episode)
            try:
                content = read_file(path, _MAX_FILE_BYTES)
                digest.update(content)
                yield self._rows(content)
            except (OSError, ValueError, pa.ArrowException) as error:
                raise InputError(
                    f"{path} is damaged ({error}): record again, or name another recording."
                ) from None
        self.fingerprint = digest.hexdigest()

    def _rows(self, content: bytes) -> Rows:
        features = step_features(self.config.vector_width)
        file = pq.ParquetFile(io.BytesIO(content))
        steps = file.metadata.num_rows
        if not 1 <= steps <= MAX_EPISODE_STEPS:
            raise ValueError(f"it has {steps} rows")
        # Checked before anything is unpacked: a small file may claim to hold a great deal.
        missing = features.keys() - set(file.schema_arrow.names)
        if missing:
            raise ValueError(f"it has no {', '.join(sorted(missing))}")
        held: dict[str, int] = {}
        unpacked = 0
        for group in range(file.metadata.num_row_groups):
            for at in range(file.metadata.num_columns):
                column = file.metadata.row_group(group).column(at)
                name = column.path_in_schema.replace(".list.element", "")
                held[name] = held.get(name, 0) + column.num_values
                unpacked += column.total_uncompressed_size
        if unpacked > _MAX_UNPACKED_BYTES:
            raise ValueError(f"it has {unpacked} bytes when unpacked")
        for name, feature in features.items():
            if held.get(name) != steps * feature.width:
                raise ValueError(f"{name} has {held.get(name, 0)} values in {steps} rows")
            kind = _kind(file.schema_arrow.field(name).type)
            if kind != pa.from_numpy_dtype(np.dtype(feature.dtype)):
                raise ValueError(f"{name} has {kind} instead of {feature.dtype}")
        table = file.read(list(features))
        rows: Rows = {"vectors": np.zeros((steps, 0), np.float32)}
        for name, column in COLUMNS.items():
            if column not in features:
                continue
            array = table[column].combine_chunks()
            while pa.types.is_nested(array.type):
                array = array.flatten()
            if array.null_count:
                raise ValueError(f"{column} has gaps")
            feature = features[column]
            values = array.to_numpy(zero_copy_only=False)
            row = () if feature.shape == (1,) else feature.shape
            rows[name] = values.reshape(steps, *row).astype(STEP_FIELDS[name].dtype)
        return rows


def _kind(column: pa.DataType) -> pa.DataType:
    """Returns the type of a column's values, without the lists around them."""
    while pa.types.is_list(column) or pa.types.is_fixed_size_list(column):
        column = column.value_type
    return column
