"""Programs that are forked instead of started.

The process that forks has done once what costs most: it has imported PyTorch and the rest, three
seconds of a core, and read a command line, a quarter of a second the first time.
"""

import fcntl
import inspect
import multiprocessing
import os
import runpy
import subprocess
import sys
import termios
from collections.abc import Callable, Mapping, Sequence
from multiprocessing import forkserver, reduction
from pathlib import Path
from typing import Any

from tests.paths import ROOT

FORKS = multiprocessing.get_context("forkserver")
FORKS.set_forkserver_preload(
    [
        *("actors.actor", "actors.evaluator", "actors.envs.ale", "actors.envs.robot"),
        *("actors.process", "learner.process", "replay.server"),
        "torch._dynamo",  # of every optimizer
        *("tests.forked", "tests.warmed", "pytest"),
    ]
)


def become(folder: Path, log: Path, arguments: Sequence[str], forks: bool) -> None:
    """Be `python ARGUMENTS` from now on, in a session and a folder of its own.

    Args:
        forks: whether the programs that it starts are forked too.
    """
    path = (str(ROOT), str(folder))  # a package that the test puts into its folder is installed
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path)}
    with log.open("wb") as file, open(os.devnull) as nothing:
        streams = (nothing.fileno(), file.fileno(), file.fileno())
        _become(folder, streams, arguments, environment, forks)


def _become(
    folder: Path,
    streams: Sequence[int],
    arguments: Sequence[str],
    environment: Mapping[str, str],
    forks: bool = True,
    first: Callable[[], object] | None = None,
) -> None:
    os.setsid()
    os.chdir(folder)
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
    if first is not None:  # what it asks of a parent, it asks of the server that forks
        first()
    if os.isatty(0):
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    # The server's own were made for other files.
    sys.stdin, sys.stdout = os.fdopen(0, closefd=False), os.fdopen(1, "w", closefd=False)
    sys.stderr = os.fdopen(2, "w", buffering=1, errors="backslashreplace", closefd=False)
    os.environ.clear()
    os.environ.update(environment)
    sys.path[:0] = environment.get("PYTHONPATH", "").split(os.pathsep)
    if forks:
        # The server that forked this process forks its children; else each would begin another.
        forkserver._forkserver.ensure_running = lambda: None  # type: ignore[method-assign]
        for name, method in FORKING.items():
            setattr(subprocess.Popen, name, method)
    module, sys.argv = arguments[0] == "-m", list(arguments)
    if module:
        sys.argv.pop(0)
        runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
    else:
        runpy.run_path(sys.argv[0], run_name="__main__")


class _Stream(int):
    """A file descriptor, which has another number in the process to which it is sent."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _received, (reduction.DupFd(int(self)),)


def _received(duplicate: Any) -> int:
    found: int = duplicate.detach()
    return found


_started = subprocess.Popen._execute_child  # type: ignore[attr-defined]
_poll, _wait = subprocess.Popen.poll, subprocess.Popen.wait


_USUAL = {
    "executable": None,
    "close_fds": True,
    "pass_fds": (),
    "shell": False,
    "restore_signals": True,
    "gid": None,
    "gids": None,
    "uid": None,
    "umask": -1,
}
"""What only a program that is started may have otherwise."""


def _start(self: Any, args: Any, *more: Any) -> None:
    """Forks `python -m MODULE`, in a session of its own; starts whatever else it is.

    Raises:
        NotImplementedError: it should have what a fork has not.
    """
    if args[:2] != [sys.executable, "-m"]:
        _started(self, args, *more)
        return
    told = inspect.signature(_started).bind(self, args, *more).arguments
    unusual = [name for name, usual in _USUAL.items() if told[name] != usual]
    if told["process_group"] > 0:
        unusual.append("process_group")
    if unusual:
        raise NotImplementedError(f"a program that is forked has no {', '.join(unusual)}")
    environment = dict(os.environ if told["env"] is None else told["env"])
    theirs = enumerate((told["p2cread"], told["c2pwrite"], told["errwrite"]))
    streams = [_Stream(number if given == -1 else given) for number, given in theirs]
    folder = told["cwd"] or Path.cwd()
    start = (folder, streams, args[1:], environment, True, told["preexec_fn"])
    self.fork = FORKS.Process(target=_become, args=start)
    self.fork.start()
    self.pid = self.fork.pid
    pipes = ("p2cread", "p2cwrite", "c2pread", "c2pwrite", "errread", "errwrite")
    self._close_pipe_fds(*(told[name] for name in pipes))


def _fork_polled(self: Any) -> int | None:
    if self.fork is None:
        return _poll(self)
    ended: int | None = self.fork.exitcode
    self.returncode = ended
    return ended


def _fork_waited(self: Any, timeout: float | None = None) -> int:
    if self.fork is None:
        return _wait(self, timeout)
    self.fork.join(timeout)
    ended = _fork_polled(self)
    if ended is None:
        assert timeout is not None
        raise subprocess.TimeoutExpired(self.args, timeout)
    return ended


FORKING = {"fork": None, "_execute_child": _start, "poll": _fork_polled, "wait": _fork_waited}
"""Members of `subprocess.Popen` by which what would be started as `python -m` is forked."""
