"""`HostedRun`: a replay, or a learner with its replay, in a process of its own.

It is watched from outside, by the statistics of accepted chunks that the replay gives on request.
"""

import time
from contextlib import ExitStack
from pathlib import Path
from typing import Self

from benchmarks.child import free_endpoint, scratch
from common.process.supervisor import Child
from common.run.join import find_run
from common.transport.chosen import connect
from replay.chunk_statistics import ChunkStatistics
from replay.client import RemoteReplay

RUN = "bench"
NEVER = 10**9
"""A number of steps that no measurement reaches, so that an epoch does not end and a replay never
waits."""
_START = 120.0
"""Maximum seconds until the process serves its run."""
_POLL = 0.02


class HostedRun:
    """``python -m MODULE`` with a run in a temporary folder; a context manager that ends it.

    Args:
        flags: flags of the module, without the run's name, folder and address.
        certificates: folder with certificates of hub and learner; the run is watched with the
            learner's. None for a run without certificates.
    """

    def __init__(self, module: str, *flags: str, certificates: Path | None = None) -> None:
        self._module = module
        self._flags = flags
        self._certificates = certificates
        self._seen = 0
        endpoint = free_endpoint()
        self.endpoint = endpoint if certificates is None else endpoint.replace("tcp/", "tls/")
        self.children: dict[str, Child] = {}
        """Processes that should be running, by their names for people."""

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            folder = stack.enter_context(scratch())
            place = ["--run", RUN, "--runs", str(folder), "--listen", self.endpoint]
            if self._certificates is not None:
                place += ["--certificates", str(self._certificates)]
            self.folder = folder
            log = folder / f"{self._module}.log"
            self.process = Child(self._module, *place, *self._flags, log=log)
            stack.callback(self.process.end)
            self.children = {self._module: self.process}

            def is_over() -> bool:
                return self.process.poll() is not None

            try:
                self.transport = connect(
                    *(self.endpoint, _START, is_over),
                    role="learner",
                    certificates=self._certificates,
                )
                stack.callback(self.transport.close)
                self.keys, self.config = find_run(self.transport, RUN, _START, is_over)
            except KeyboardInterrupt:
                self.check()  # the wait may have failed because the process ended
                raise
            self._replay = RemoteReplay(self.transport, self.keys, self.config)
            self._watch(stack)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _watch(self, stack: ExitStack) -> None:
        """Starts what else a subclass needs when the run is ready; ``stack`` ends it."""

    def check(self) -> None:
        """Checks that no process ended by itself.

        Raises:
            InputError: a process ended; the message has its last line.
        """
        for name, child in self.children.items():
            if child.poll() is not None:
                raise child.failure(name)

    def next_chunks(self) -> tuple[float, tuple[ChunkStatistics, ...]]:
        """Waits for chunks; returns the time at which they were seen, and their statistics."""
        while True:
            chunks = self._replay.progress(self._seen).statistics
            now = time.monotonic()
            self.check()
            if chunks:
                self._seen = chunks[-1].index + 1
                return now, chunks
            time.sleep(_POLL)
