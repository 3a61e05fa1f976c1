"""A process that only keeps cores busy, beside which others are measured."""

import hashlib
import math
import threading
import time

from benchmarks.child import serve

_BLOCK = bytes(2**18)
"""Bytes that are hashed at a time; hashing so many releases Python's lock."""
_PAUSE = 0.001


class Busy:
    """Keeps ``cores`` cores busy, or as much of them as it gets, until it ends."""

    def __init__(self, cores: float) -> None:
        threads = math.ceil(cores)
        for _ in range(threads):
            threading.Thread(target=_work, args=[cores / threads], daemon=True).start()

    def counts(self) -> dict[str, float]:
        """Returns the seconds of processor time that it has taken since its start."""
        return {"cpu": time.process_time()}


def _work(share: float) -> None:
    began = time.monotonic()
    while True:
        if time.thread_time() < share * (time.monotonic() - began):
            hashlib.sha256(_BLOCK)
        else:
            time.sleep(_PAUSE)


if __name__ == "__main__":
    serve(Busy)
