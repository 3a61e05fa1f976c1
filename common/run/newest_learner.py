"""What the newest learner of a run writes of itself into the run's folder."""

import json
import shlex
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import StringConstraints

from common.atomic_file import write_json
from common.checked import build
from common.regular_file import read_file
from common.run.folder import RunFolder

_Text = Annotated[str, StringConstraints(max_length=2**17)]
"""A path or a command line, as long as Linux takes one."""


Ended = Literal["done", "stopped"]
"""A run has all its steps, or was stopped before."""


@dataclass(frozen=True)
class NewestLearner:
    """One learner's work at a run, from its start to its end."""

    run: _Text
    """The run's folder."""
    endpoint: str
    """Address of the run's hub, as processes of this machine reach it."""
    certificates: _Text | None
    """Folder of the learner's certificates; None without them."""
    directory: _Text
    """Working directory, in which `resume_command` is meant."""
    resume_command: _Text
    """Command that continues the run."""
    keeps_snapshots: bool
    """Whether each epoch's weights stay in the run's ``snapshots/``."""
    ended: Ended | None = None
    """How it ended; None while it works, or if an error or a kill ended it."""

    @classmethod
    def of(cls, folder: RunFolder) -> Self | None:
        """Returns that of a run's newest learner; None if there is none that can be read, or if it
        is another run's, of which the folder is a copy."""
        with suppress(OSError, ValueError, RecursionError):
            found = build(cls, json.loads(read_file(folder.newest_learner)))
            return found if found.run == str(folder.path.resolve()) else None
        return None

    @property
    def command(self) -> str:
        """Command that continues the run from the present working directory."""
        if Path.cwd() == Path(self.directory):
            return self.resume_command
        return f"cd {shlex.quote(self.directory)} && {self.resume_command}"

    def write(self, folder: RunFolder) -> None:
        """Writes it into the run's folder."""
        write_json(folder.newest_learner, asdict(self))
