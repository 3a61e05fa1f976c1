"""What a benchmark with processes of its own needs: an address for them, and a way to end.

`Helper` is a process that works on demand, `run_module` one that is waited for.
"""

import contextlib
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from common.errors import InputError
from common.process.supervisor import Child


def free_endpoint() -> str:
    """An address of this machine at which nobody listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextlib.contextmanager
def scratch(place: Path | None = None) -> Iterator[Path]:
    """A temporary folder, in ``place`` or where the system has them."""
    prefix = "ale-robot-bench-"
    with tempfile.TemporaryDirectory(prefix=prefix, dir=place, ignore_cleanup_errors=True) as name:
        yield Path(name)


def end_as_by_ctrl_c() -> None:
    """Let SIGTERM unwind this process, so that nothing it started is left behind."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)


def run_module(module: str, *arguments: str, quiet: bool = False) -> None:
    """Runs ``python -m module`` on this terminal, and waits until it has ended.

    When this process is interrupted, the module is asked to end, and may still write a checkpoint.

    Args:
        quiet: whether only its errors are shown.

    Raises:
        InputError: it failed, and has said why.
    """
    output = subprocess.DEVNULL if quiet else None
    process = subprocess.Popen([sys.executable, "-m", module, *arguments], stdout=output)
    try:
        process.wait()
    except KeyboardInterrupt:
        process.terminate()
        process.wait()
        raise
    if process.returncode:
        raise InputError(
            f"python -m {module} ended with exit code {process.returncode}, see above."
        )


class Helper(Child):
    """A child process that answers on its standard output what it reads on its standard input.

    A context manager that ends it.

    Args:
        name: what people call it.
    """

    def __init__(self, name: str, module: str, *arguments: str) -> None:
        super().__init__(module, *arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.name = name

    def __exit__(self, *_: object) -> None:
        self.end()

    def say(self, line: str) -> None:
        """Writes a line to it; that it is gone is noticed by `hear`."""
        assert self.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self.stdin.write(f"{line}\n")
            self.stdin.flush()

    def hear(self) -> str:
        """Returns its next line.

        Raises:
            InputError: it ended, and has said why.
        """
        assert self.stdout is not None
        line = self.stdout.readline()
        if not line:
            raise InputError(f"the process of {self.name} failed, see above.")
        return line.strip()
