"""What the newest learner of a run writes of itself into the run's folder."""

import json
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Self

from common.atomic_file import write_json
from common.checked import LongText, build
from common.regular_file import read_file
from common.run.folder import RunFolder


@dataclass(frozen=True)
class NewestLearner:
    """One learner's work at a run, from its start to its end."""

    endpoint: str
    """Address of the run's hub, as processes of this machine reach it."""
    certificates: LongText | None
    """Folder of the learner's certificates; None without them."""
    go_on: LongText
    """Command that continues the run."""
    keeps_snapshots: bool
    """Whether each epoch's weights stay in the run's ``snapshots/``."""

    @classmethod
    def of(cls, folder: RunFolder) -> Self | None:
        """Returns that of a run's newest learner; None if there is none that can be read."""
        with suppress(OSError, ValueError, RecursionError):
            return build(cls, json.loads(read_file(folder.newest_learner)))
        return None

    def write(self, folder: RunFolder) -> None:
        """Writes it into the run's folder."""
        write_json(folder.newest_learner, asdict(self))
