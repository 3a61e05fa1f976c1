"""The folder ``runs/<name>/``: the files of a run, and the locks of the processes that use it."""

import fcntl
import json
import os
import shutil
import struct
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Literal, Self, get_args

from common.atomic_file import write_atomically
from common.errors import InputError, cannot_read, cannot_write, choice, writing
from common.protocol.run_keys import check_name
from common.regular_file import no_links, not_waiting, read_file
from common.settings.config import RunConfig
from common.settings.stored_config import differences, from_mapping, to_json

_EPOCH = "epoch-"


def epoch_name(epoch: int) -> str:
    """Returns the name of an epoch's files, without the suffix."""
    return f"{_EPOCH}{epoch:04d}"


def kept_networks(snapshots: Path) -> dict[int, Path]:
    """Returns the files of weights in a run's ``snapshots/``, by epoch, oldest first."""
    files = snapshots.glob(f"{_EPOCH}*.safetensors")
    names = {path.stem.removeprefix(_EPOCH): path for path in files}
    return dict(sorted((int(name), path) for name, path in names.items() if name.isdecimal()))


RUNS = Path("runs")
"""Folder of the runs that go by their names."""
CONFIG, SUMMARY, EPOCHS = "config.json", "summary.json", "epochs.csv"
INITIAL, CHECKPOINT = "initial.safetensors", "checkpoint.safetensors"
"""Names of files in a run's folder; `RunFolder` says what they hold."""
JOURNAL = "journal.jsonl"
"""Name of the file, in a replay's folder, that records what was accepted and evicted."""
MAX_LISTED = 12
"""Number of runs that an error lists."""
Part = Literal["learner", "replay"]
_WHOLE = struct.pack("hhqqi4x", fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)
"""`struct flock` of an exclusive lock on a whole file."""


class RunFolder:
    """The folder of a run. One process per part (learner, replay) locks it while it works."""

    def __init__(self, runs: Path, name: str) -> None:
        self.name = check_name("run", name)
        self.path = path = runs / name
        self.config_file = path / CONFIG
        """The `RunConfig`, written once."""
        self.initial = path / INITIAL
        """The weights with which the run began, if they were given."""
        self.demonstrations = path / "demonstrations.json"
        """The recording with which its replay began, if there was one."""
        self.checkpoint = path / CHECKPOINT
        """The learner's whole state."""
        self.previous = path / "checkpoint.previous.safetensors"
        """The checkpoint before that."""
        self.held_out = path / "held_out.safetensors"
        """The states on which the mean max-Q is measured."""
        self.snapshots = path / "snapshots"
        """The weights of epochs that are being tested, and the best so far."""
        self.epochs = path / EPOCHS
        self.gates = path / "gates.csv"
        self.summary = path / SUMMARY
        self.newest_learner = path / "learner.json"
        """What the newest learner says of itself (`common.run.newest_learner`)."""
        self.tensorboard = path / "tensorboard"
        self.replay = path / "replay"
        """The ring, if the replay runs on this machine."""
        self.films = path / "films"
        self.logs = path / "logs"
        """The output of local mode's actors and of films, and the files of `kept_log`."""
        self._locks: dict[Part, IO[str]] = {}
        """The files that this process has locked, by the part that it claimed."""
        self._made = False

    @property
    def has_begun(self) -> bool:
        """Whether a learner has worked here. One that ended before its first checkpoint may have
        left only a table of epochs."""
        return any(path.exists() for path in (self.checkpoint, self.previous, self.epochs))

    @classmethod
    def at(cls, path: Path) -> Self | None:
        """Returns the run whose folder is ``path``; None if it is not the folder of a run."""
        if path.name in ("", ".."):  # as ".", in the folder itself
            path = path.resolve()
        return cls(path.parent, path.name) if (path / CONFIG).is_file() else None

    @classmethod
    def named(cls, path: Path) -> Self | None:
        """Returns the run whose folder is ``path``, or else the run in `RUNS` whose name that is;
        None if there is neither."""
        run = cls.at(path)
        return cls.at(RUNS / path) if run is None and path.parent == Path() else run

    @classmethod
    def existing(cls, path: Path) -> Self:
        """Returns the run that `named` finds. Raises InputError if there is none."""
        if (run := cls.named(path)) is None:
            names = [each.name for each in cls.all_in(RUNS)]
            there = f"{RUNS.resolve()} has {', '.join(names[:MAX_LISTED]) or 'none'}"
            meant = choice(path.name, names, f"name one, or its folder; {there}.")
            raise InputError(f"{path} is not a run: {meant}")
        return run

    def resolved(self) -> Self:
        """Returns the same run, by the path that no link leads to."""
        real = self.path.resolve()
        return type(self)(real.parent, real.name)

    @classmethod
    def all_in(cls, runs: Path) -> list[Self]:
        """Returns the runs in the folder ``runs``, by name; what cannot be a run's is passed
        over."""
        found = []
        for file in sorted(runs.glob(f"*/{CONFIG}")):
            with suppress(InputError):
                found.append(cls(runs, file.parent.name))
        return found

    def stored_config(self) -> RunConfig | None:
        """Returns the configuration with which the run was started; None for a new run. Raises
        InputError if the file cannot be read."""
        try:
            told = json.loads(read_file(self.config_file))
            return from_mapping(RunConfig, told, str(self.config_file), fill=True)
        except FileNotFoundError:
            return None
        except (OSError, ValueError, RecursionError) as error:
            raise cannot_read(self.config_file, error) from None

    def check_claim(self, part: Part, config: RunConfig, *, resume: bool) -> RunConfig | None:
        """Returns the configuration with which the run was started, as `stored_config`. Raises
        InputError if there is something to resume but ``resume`` is false, or the reverse; or if
        the run has a different configuration.

        Args:
            config: the configuration of this process.
            resume: whether to continue what is there.
        """
        stored = self.stored_config()
        if resume and stored is None:
            runs = [path.parent.name for path in self.path.parent.glob(f"*/{CONFIG}")]
            hint = choice(self.name, runs, "start it without --resume.")
            raise InputError(f"there is no run in {self.path} to resume: {hint}")
        if not resume and self._has_started(part):
            others = "go on with it by --resume, name another with --run, or delete that folder"
            if self.is_at_work(part):
                others = f"a {part} is at work there: name another with --run"
            raise InputError(f"{self.path} already holds a run: {others}.")
        # The settings of a start that failed, for lack of space or by a setting, may be changed.
        bound = resume or self.checkpoint.exists() or self.replay.exists() or self.is_at_work()
        if bound and stored is not None and (unequal := differences(stored, config)):
            another = f" --initial {self.path}" if self.checkpoint.exists() else ""
            # Without --resume, they may also be those of a preset that nobody named.
            take = "omit those flags" if resume else f"take them by --config {self.config_file}"
            raise InputError(
                f"the run in {self.path} keeps its settings ({'; '.join(unequal[:5])}): {take}, or "
                f"begin another run with other ones: --run ANOTHER{another}, without --resume."
            )
        return stored

    def check_place(self) -> None:
        """Raises InputError if the folder cannot be made, or nothing can be written into it."""
        with writing(self.path):
            there = next(path for path in (self.path, *self.path.parents) if path.exists())
            with tempfile.TemporaryFile(dir=there):
                pass

    def claim(
        self,
        part: Part,
        config: RunConfig,
        *,
        resume: bool,
        begin: Callable[[], None] = lambda: None,
    ) -> None:
        """Claims ``part`` of the run for this process, and settles the run's configuration. Raises
        InputError if another process holds the part, or `check_claim` does.

        Args:
            begin: writes what the run begins with. A process that is killed before or within it
                leaves no configuration, and therefore nothing to resume.
        """
        self.check_claim(part, config, resume=resume)  # what is refused makes no folder
        with writing(self.path):
            self._made |= not self.path.exists()
            self.path.mkdir(parents=True, exist_ok=True)
            claims = self._opened("claim")
            fcntl.fcntl(claims, fcntl.F_OFD_SETLKW, _WHOLE)
        with claims:  # learner and replay, which may start at once, settle one configuration
            stored = self.check_claim(part, config, resume=resume)
            try:
                lock = self._opened(part)
                fcntl.fcntl(lock, fcntl.F_OFD_SETLK, _WHOLE)
            except BlockingIOError:
                raise InputError(
                    f"another {part} is at work in {self.path}: end it, or name another run with "
                    "--run."
                ) from None
            except OSError as error:
                raise cannot_write(self.path, error) from None
            self._locks[part] = lock  # held until the process ends, in whatever way
            begin()
            if stored != config:
                write_atomically(self.config_file, to_json(config).encode())

    @contextmanager
    def removed_if_unused(self) -> Iterator[None]:
        """Removes the folder at the end of the block if this process made it and nothing began in
        it, so that a failed start leaves nothing behind. A learner that fails before its first
        checkpoint has begun nothing, although its replay may be there."""
        failed = True
        try:
            yield
            failed = False
        finally:
            at_first = {
                self.config_file,
                self.initial,
                self.demonstrations,
                self.newest_learner,
                self.logs,
                self._lock("claim"),
                *map(self._lock, self._locks),
            }
            if failed and {*self._locks} == {*get_args(Part)}:
                at_first |= {self.replay, self.gates, self.tensorboard}
            with suppress(FileNotFoundError):  # somebody may have removed it meanwhile
                if self._made and at_first.issuperset(self.path.iterdir()):
                    shutil.rmtree(self.path)

    def _has_started(self, part: Part) -> bool:
        checkpoints = (self.checkpoint, self.previous)
        return any(path.exists() for path in (checkpoints if part == "learner" else [self.replay]))

    def _lock(self, what: Part | Literal["claim"]) -> Path:
        return self.path / f".{what}.lock"

    def _opened(self, what: Part | Literal["claim"]) -> IO[str]:
        return os.fdopen(no_links(str(self._lock(what)), os.O_WRONLY | os.O_CREAT), "w")

    def is_at_work(self, *parts: Part) -> bool:
        """Whether a process, this one or another, holds one of ``parts``; by default any part."""
        for part in parts or get_args(Part):
            with suppress(FileNotFoundError), open(self._lock(part), opener=not_waiting) as lock:
                # Looking takes no lock, so a process that claims the part meanwhile succeeds.
                found = fcntl.fcntl(lock, fcntl.F_OFD_GETLK, _WHOLE)
                if struct.unpack_from("h", found) != (fcntl.F_UNLCK,):
                    return True
        return False
