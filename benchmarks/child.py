"""Processes of this repository that a benchmark starts, and where they meet."""

import contextlib
import signal
import socket
import subprocess
import sys
from typing import Any

from common.errors import InputError
from learner.local_launcher import child_environment

_STOP = 30.0
"""Seconds that a process has to leave before it is killed."""


def free_endpoint() -> str:
    """An address of this machine at which nobody listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def end_as_by_ctrl_c() -> None:
    """Let SIGTERM unwind this process, so that nothing it started is left behind."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)


def start(module: str, *arguments: str, **streams: Any) -> subprocess.Popen[str]:
    """``python -m module arguments``, in a session of its own.

    Args:
        streams: stdin, stdout and stderr, as of `subprocess.Popen`; without, there is no input.
    """
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        env=child_environment(),
        start_new_session=True,
        text=True,
        **{"stdin": subprocess.DEVNULL, **streams},
    )


def failure(name: str, said: str) -> InputError:
    """That a process ended by itself, with the last line of what it said."""
    lines = said.strip().splitlines() or ["nothing"]
    return InputError(f"the {name} ended, and said: {lines[-1].removeprefix('error: ')}")


def end(process: subprocess.Popen[str]) -> None:
    """Ask it to leave, wait until it has, and close what was open to it."""
    process.terminate()
    try:
        process.wait(_STOP)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with contextlib.suppress(BrokenPipeError):
                stream.close()
