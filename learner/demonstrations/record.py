"""The record of a run's demonstrations that is kept in its folder."""

import json
from dataclasses import asdict, dataclass
from typing import Annotated

from pydantic import StringConstraints

from common.checked import Count, build
from common.errors import InputError
from common.regular_file import read_file
from common.run.folder import RunFolder


@dataclass(frozen=True)
class DemonstrationsRecord:
    """The recording with which a run begins, and whether its replay has it."""

    path: Annotated[str, StringConstraints(max_length=4_096)]  # as on Linux
    fingerprint: str
    """Hash of the recording, see `common.dataset.reader.Dataset`."""
    steps: Count
    complete: bool = False
    """Whether the replay has all of them."""

    @classmethod
    def of(cls, folder: RunFolder) -> "DemonstrationsRecord | None":
        """Returns the record in ``folder``; None for a run without demonstrations.

        Raises:
            InputError: the file is damaged.
        """
        try:
            return build(cls, json.loads(read_file(folder.demonstrations)))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, RecursionError) as error:
            raise InputError(
                f"{folder.demonstrations} is damaged ({error}): repair or restore it."
            ) from None

    def encode(self) -> bytes:
        """Returns the record as JSON, which `of` reads."""
        return json.dumps(asdict(self)).encode()
