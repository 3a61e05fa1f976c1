"""The error of a replay whose files are damaged."""

from pathlib import Path

from common.errors import InputError
from common.run.folder import CHECKPOINT


def damaged(path: Path, how: str) -> InputError:
    """Returns the error that says that a replay's file is damaged."""
    return InputError(
        f"{path} is damaged {how}: put it back from a copy, or begin another run, with "
        f"this one's network by --initial {path.parent.parent / CHECKPOINT}."
    )
