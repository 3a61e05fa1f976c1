"""The actors of `benchmarks.many_actors`, all in one process.

Each has a session, a name and an insert client of its own, as if on a machine of its own. Only the
robot is missing: chunks of its camera's frames are due at the pace of a robot in real time.
"""

import threading
import time
from queue import Empty, SimpleQueue
from typing import Any

from actors.member import Member
from actors.stream.insert_client import InsertClient
from benchmarks.child import serve
from benchmarks.synthetic import camera_chunks
from benchmarks.transport_client import Answers, count_answers
from common.run.join import find_run
from common.transport.chosen import connect

_PATIENCE = 60.0
_FLUSH = 30.0
_BROADCAST = 10.0
"""Seconds after which weights count as dropped on the way, as happens on a full link."""


class Crowd:
    def __init__(self, actors: int, connect_to: str, run: str) -> None:
        began = time.monotonic()
        self._answers: list[Answers] = []
        self._arrived: SimpleQueue[float] = SimpleQueue()
        """Times at which actors got weights, on the machine's monotonic clock."""
        self._clients: list[InsertClient] = []
        names = tuple(f"actor-{n}" for n in range(actors))
        for name in names:
            transport = connect(connect_to, _PATIENCE)
            keys, config = find_run(transport, run, _PATIENCE)
            self._answers.append(count_answers(transport))
            transport.subscribe(keys.weights, lambda _: self._arrived.put(time.monotonic()))
            member = Member(name, transport, keys, config, _PATIENCE, threading.Event())
            self._clients.append(InsertClient(member))
        self._steps = config.stream.chunk_steps
        self._join_seconds = time.monotonic() - began
        self._chunks = camera_chunks(keys.run_id, names, config)

    def join_seconds(self) -> float:
        return self._join_seconds

    def play(self, seconds: float, steps_per_second: float) -> dict[str, Any]:
        """Sends chunks when they are due, each actor's shifted against the others'.

        Returns:
            counts. They include the chunks held back because the actor's window was full, for which
            a robot would have waited, and the seconds by which the last chunk was late.
        """
        clients = self._clients
        period = self._steps / steps_per_second / len(clients)
        due = int(seconds / period)
        began, spent, held_back = time.monotonic(), time.process_time(), 0
        for n in range(due):
            client = clients[n % len(clients)]
            wait = began + n * period - time.monotonic()
            if wait > 0:
                time.sleep(wait)
            payload = next(self._chunks).encode()
            held_back += client.unacknowledged >= client.window
            client.send(payload)
        late = time.monotonic() - began - (due - 1) * period
        time.sleep(max(0.0, period - late))  # what the next chunk would have waited for
        for client in clients:
            client.flush(_FLUSH)
        return {
            "chunks": due,
            "held_back": held_back,
            "late_seconds": late,
            "cpu_seconds": time.process_time() - spent,
            "latencies": [each for actor in self._answers for each in actor.seconds],
            "acknowledged": sum(each.acked for each in clients),
            "sent_again": sum(each.retried for each in clients),
        }

    def arrivals(self) -> list[float]:
        """Waits until all actors have the weights, or no more come; returns the times in order."""
        until, moments = time.monotonic() + _BROADCAST, []
        try:
            for _ in self._clients:
                moments.append(self._arrived.get(timeout=max(until - time.monotonic(), 0)))
        except Empty:
            pass
        return sorted(moments)


if __name__ == "__main__":
    serve(Crowd)
