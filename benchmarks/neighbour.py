"""`neighbour`: a process that trains a network on one thread during a measurement, as a learner.

Two cores of a rented machine may be one, or share caches and memory. A process measured alone is
then faster than beside others.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import torch

from benchmarks.child import Helper
from benchmarks.peer_update import ours
from common.process.lifeline import leave_with_parent


@contextmanager
def neighbour() -> Iterator[None]:
    """Keeps a neighbour at work within its context."""
    with Helper("the neighbour", "benchmarks.neighbour") as helper:
        helper.hear()
        yield


def main() -> None:
    torch.set_num_threads(1)
    update = ours()
    update()
    print("null", flush=True)
    leave_with_parent()
    while True:
        update()


if __name__ == "__main__":
    main()
