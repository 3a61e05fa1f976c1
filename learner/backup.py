"""`python -m learner.backup runs/NAME -o FOLDER`: copies a run, even while it is training.

The copy is what a power failure would have left: `--resume` continues from its checkpoint. The
order of copying guarantees this:

1. the checkpoint, because a replay may know of more steps than the checkpoint, but not of fewer;
2. the replay's journal, so that it names no chunk that arrives later;
3. everything else. Rows that are overwritten during the copy fail their checksum and are left out.
"""

import os
import shlex
import shutil
import sys
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from common.command_line.parser import parse
from common.errors import InputError, writing
from common.exit_codes import INTERRUPTED
from common.process.lifeline import on_signals
from common.process.program_end import exit_on_input_error
from common.process.progress import Progress
from common.run.folder import JOURNAL, RunFolder

_BLOCK = 64 * 2**20


@dataclass(frozen=True)
class BackupOptions:
    """Copy a run, even while it is training, to continue it elsewhere."""

    run: tyro.conf.Positional[Path]
    """Run to copy, or its folder."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder of the copy, which must not exist yet; its name becomes the copy's run name."""


def back_up(options: BackupOptions, stop: threading.Event) -> tuple[RunFolder, RunFolder]:
    """Copies the run; returns the run, and the copy, which is complete and on the disk.

    Raises:
        InputError: there is no run, the copy's folder exists already or is inside of the run, or
            ``stop`` was set; there is no copy then.
        OSError: a file cannot be read or written, as on a full disk; there is no copy then.
    """
    source = RunFolder.existing(options.run).resolved()
    target = RunFolder(options.output.resolve().parent, options.output.resolve().name)
    if target.path.exists():
        raise InputError(f"{options.output} already exists: name a new folder.")
    if target.path.is_relative_to(source.path):
        raise InputError(f"{options.output} is inside of the run: name a folder outside.")
    with writing(target.path):
        target.path.parent.mkdir(parents=True, exist_ok=True)
        # Only its owner can read this folder: a run on Slurm has its keys in it.
        unfinished = Path(tempfile.mkdtemp(prefix=f"{target.name}.", dir=target.path.parent))
    try:
        _copy(source, unfinished, stop)
        os.sync()
        unfinished.rename(target.path)
        os.sync()
    except BaseException:
        shutil.rmtree(unfinished, ignore_errors=True)
        raise
    return source, target


def _files(source: RunFolder) -> Iterator[Path]:
    """Yields all files in the order in which they have to be copied."""
    first = [source.checkpoint, source.previous, source.replay / JOURNAL]
    yield from (path for path in first if path.exists())
    # `rglob` does not follow links, and the replay may be a link to another disk. A link to a file
    # is not copied: in a stranger's run it could be to any file of this machine.
    for path in sorted({*source.path.rglob("*"), *source.replay.rglob("*")}):
        skipped = path in (source.newest_learner, source.config_file)
        skipped |= path.suffix in (".tmp", ".kept", ".lock")
        if path.is_file() and not path.is_symlink() and path not in first and not skipped:
            yield path
    yield source.config_file  # without which a copy that was killed is no run


def _copy(source: RunFolder, place: Path, stop: threading.Event) -> None:
    copied = 0
    with Progress("copying", None) as progress:
        for path in _files(source):
            try:
                file = path.open("rb")
            except FileNotFoundError:  # deleted since it was listed
                continue
            fresh = place / path.relative_to(source.path)
            fresh.parent.mkdir(parents=True, exist_ok=True)
            with file, fresh.open("xb") as copy:
                os.fchmod(copy.fileno(), os.fstat(file.fileno()).st_mode & 0o777)
                while block := file.read(_BLOCK):
                    if stop.is_set():
                        told = "the copy was stopped, and nothing of it is left: copy again."
                        raise InputError(told, INTERRUPTED)
                    copied += copy.write(block)
                    progress.update(copied, note=f"{copied / 1e9:.1f} GB")


def main() -> None:
    options = parse(BackupOptions, "learner.backup", sys.argv[1:])
    stop = threading.Event()
    on_signals(stop)
    run, copy = back_up(options, stop)
    where = shlex.join(["--runs", str(copy.path.parent), "--run", copy.name])
    # A replay in a process of its own may have its own folder, without a checkpoint.
    replay_alone = copy.replay.exists() and not copy.checkpoint.exists()
    print(
        f"{options.run} is copied to {copy.path}. "
        "To continue the copy, with the run's other flags:\n"
        f"  ale-robot {'replay' if replay_alone else 'train'} --resume {where}"
    )
    if copy.name != run.name:
        print(
            f"The copy is called {copy.name}: to let the actors of {run.name} join it, rename its "
            f"folder to {run.name}."
        )


if __name__ == "__main__":
    exit_on_input_error(main)
