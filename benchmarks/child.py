"""Processes for benchmarks: free addresses, temporary folders, and processes that surely end.

`Helper` is a process whose object's methods are called; `run_module` waits for a whole process. A
program that starts any of them is run by `run_program`.
"""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from common.errors import InputError
from common.process.program_end import exit_on_input_error
from common.process.restarts import end_with_parent
from common.process.supervisor import Child


def free_port() -> int:
    """Returns a port of this machine at which nobody listens.

    For a minute, the kernel gives it to no other process, because it remembers a connection that
    this side ended (TIME_WAIT). A server that sets SO_REUSEADDR, as servers do, can still listen
    there. The package ephemeral-port-reserve does the same.
    """
    with socket.socket() as place, socket.socket() as guest:
        place.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        place.bind(("127.0.0.1", 0))
        place.listen()
        guest.connect(place.getsockname())
        # The side that closes first remembers the connection, so the guest closes later.
        place.accept()[0].close()
        port: int = place.getsockname()[1]
        return port


def free_endpoint() -> str:
    """Returns an address of this machine at which nobody listens."""
    return f"tcp/127.0.0.1:{free_port()}"


@contextlib.contextmanager
def scratch(place: Path | None = None) -> Iterator[Path]:
    """Yields a temporary folder, in ``place`` or in the system's usual place."""
    prefix = "ale-robot-bench-"
    with tempfile.TemporaryDirectory(prefix=prefix, dir=place, ignore_cleanup_errors=True) as name:
        yield Path(name)


def run_program(work: Callable[[], int | None]) -> None:
    """Runs ``work`` and ends this process, as `exit_on_input_error` does. SIGTERM unwinds the stack
    as Ctrl-C does, so that no process that was started is left behind."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    exit_on_input_error(work)


def run_module(
    module: str, *arguments: str, quiet: bool = False, env: Mapping[str, str] | None = None
) -> None:
    """Runs ``python -m module`` on this terminal, and waits until it has ended.

    When this process is interrupted or killed, the module is asked to end and may still write a
    checkpoint.

    Args:
        quiet: whether only its errors are shown.
        env: environment variables that it gets besides those of this process.

    Raises:
        InputError: the module failed and printed why.
    """
    output = subprocess.DEVNULL if quiet else None
    command = [sys.executable, "-m", module, *arguments]
    process = subprocess.Popen(
        command,
        stdout=output,
        env=os.environ | (env or {}),
        preexec_fn=end_with_parent,
    )
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


def refusal(*command: str | Path, **how: Any) -> str | None:
    """Runs ``command``; returns why it failed, None if it succeeded.

    Args:
        how: arguments of `subprocess.run`.
    """
    try:
        done = subprocess.run(command, capture_output=True, text=True, **how)
    except OSError as error:
        return f"{command[0]} cannot be run ({error.strerror})"
    said = " ".join(done.stderr.split())
    return f"{command[0]} failed: {said}" if done.returncode else None


def stat_of(process: int) -> list[str]:
    """Returns the fields of /proc/PID/stat after the name: state, parent and so on."""
    # The name, in brackets, may hold anything, even brackets; only the fields after it are safe.
    return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()


def cpu_seconds(stat: list[str]) -> float:
    """Returns the seconds of processor time in the fields of `stat_of`."""
    return sum(map(int, stat[11:13])) / os.sysconf("SC_CLK_TCK")


class Helper(Child):
    """A child process that holds an object and calls its methods on request.

    It is a context manager that ends the process. Arguments and results are values of JSON.

    Args:
        name: name of the process for people.
        module: module whose main program is `serve`.
        settings: arguments for making the object.
    """

    def __init__(self, name: str, module: str, /, **settings: Any) -> None:
        pipe = subprocess.PIPE
        super().__init__(module, json.dumps(settings), stdin=pipe, stdout=pipe)
        self.name = name

    def __exit__(self, *_: object) -> None:
        self.end()

    def begin(self, method: str, *arguments: Any) -> None:
        """Starts a call of a method; `hear` notices if the process has gone."""
        assert self.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self.stdin.write(f"{json.dumps([method, *arguments])}\n")
            self.stdin.flush()

    def hear(self) -> Any:
        """Returns the result of the next method that was begun.

        Raises:
            InputError: the process ended and printed why.
        """
        assert self.stdout is not None
        line = self.stdout.readline()
        if not line:
            raise InputError(f"the process of {self.name} failed, see above.")
        return json.loads(line)

    def ask(self, method: str, *arguments: Any) -> Any:
        """Returns the result of a method; raises InputError as `hear` does."""
        self.begin(method, *arguments)
        return self.hear()


def serve(make: Callable[..., object]) -> None:
    """Runs the main program of a `Helper`, which ends when its parent has gone."""

    def work() -> None:
        made = make(**json.loads(sys.argv[1]))
        for line in sys.stdin:
            method, *arguments = json.loads(line)
            print(json.dumps(getattr(made, method)(*arguments)), flush=True)

    exit_on_input_error(work)
