"""What the units of `deploy/systemd` rest on: each process tells systemd how it is."""

import signal
import socket
import uuid
from contextlib import ExitStack

from tests.end_to_end.conftest import SMALL, Program, Stage
from tests.patience import PATIENCE

SERVICE = """
import os, runpy, sys
_, os.environ["NOTIFY_SOCKET"], module, *sys.argv[1:] = sys.argv
runpy.run_module(module, run_name="__main__", alter_sys=True)
"""


def test_services_tell_when_they_are_ready_that_they_work_and_that_they_end(stage: Stage) -> None:
    script = stage.folder / "service.py"
    script.write_text(SERVICE)
    run = ("--run=r", "--env=ale", *SMALL)
    with ExitStack() as stack:

        def service(*arguments: str) -> tuple[Program, socket.socket]:
            """Returns the program and its service manager, once that knows it is ready."""
            address = uuid.uuid4().hex
            manager = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
            manager.bind(f"\0{address}")
            manager.settimeout(PATIENCE)
            program = stage.start(str(script), f"@{address}", *arguments)
            assert b"READY=1" in manager.recv(10_000).split(b"\n")
            return program, manager

        def hears(manager: socket.socket, what: bytes) -> None:
            while what not in manager.recv(10_000).split(b"\n"):
                pass

        there = ("--connect", stage.endpoint)
        replay = service("replay", "--listen", stage.endpoint, *run)
        learner = service("learner", *there, "--threads=1", *run)
        actor, _ = service("actors", *there, "--sync", "--name=a")
        # A learner that waits for steps works too, and leaves the cores to others.
        actor.send(signal.SIGTERM)
        actor.ends()
        for program, manager in (learner, replay):
            hears(manager, b"WATCHDOG=1")
            hears(manager, b"WATCHDOG=1")
            program.send(signal.SIGTERM)
            hears(manager, b"STOPPING=1")
            program.ends()
