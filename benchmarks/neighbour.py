"""`neighbour`: a process that trains a network on one thread meanwhile, as a learner would.

Two cores of a rented machine may be one, or share caches and memory: what is measured alone is
then not what is to be had beside others.
"""

import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import torch

from benchmarks.peer_update import ours
from common.process.lifeline import leave_with_parent
from common.process.supervisor import Child

_READY = "ready"


@contextmanager
def neighbour() -> Iterator[None]:
    """One is at work."""
    with Child("benchmarks.neighbour", stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            if process.stdout.readline().strip() != _READY:
                raise RuntimeError("the process beside this one did not start, see above")
            yield
        finally:
            process.kill()


def main() -> None:
    torch.set_num_threads(1)
    update = ours()
    update()
    print(_READY, flush=True)
    stop = threading.Event()
    leave_with_parent(stop)
    while not stop.is_set():
        update()


if __name__ == "__main__":
    main()
