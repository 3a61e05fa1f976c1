"""The flooder of `benchmarks.flood`: one actor's connection that sends as much as it can.

Its chunks are valid and its own; only their number is wrong. They are sent as fast as possible.
Heartbeats and requests for the newest weights come far more often than a hub accepts them, but not
so often that they hold up the chunks, which cost a hub most.
"""

import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path

from benchmarks.child import serve
from benchmarks.synthetic import camera_chunks
from common.errors import InputError, MessageError
from common.process.allocator import keep_large_blocks
from common.process.threads import guarded
from common.protocol.ack import Ack
from common.protocol.actor_stats import ActorStats
from common.run.join import find_run
from common.transport.chosen import connect
from common.transport.interface import Envelope, Unanswered

_PATIENCE = 60.0
_DEADLINE = 5.0
_CHUNKS_UNDER_WAY = 64
"""Maximum unanswered chunks, many times an honest actor's window; a connection carries no more."""
_QUESTIONS_UNDER_WAY = 1_024
"""Maximum unanswered requests for weights; one that the hub drops takes a second."""
_QUESTION_DEADLINE = 1.0
_PAUSE = 0.0005
"""Seconds after a heartbeat or a request; a hub accepts one heartbeat in 0.01 s, one request in
0.2 s."""
_OUT = 0.01
"""Seconds between two checks, after a cut-off, whether it is connected again."""
_SWITCH = 0.0001
"""Maximum seconds that a thread waits for another thread of Python's; the usual 0.005 would be lost
for each chunk."""


class Flooder:
    """A client that floods a run's hub.

    Args:
        certificates: folder with a certificate for ``name``.
    """

    def __init__(self, connect_to: str, run: str, name: str, certificates: str) -> None:
        keep_large_blocks()
        sys.setswitchinterval(_SWITCH)
        folder = Path(certificates)
        transport = connect(connect_to, _PATIENCE, name=name, certificates=folder)
        self._transport = transport  # keeps the session open
        keys, config = find_run(transport, run, _PATIENCE)
        self._counts: Counter[str] = Counter()
        self._counting = threading.Lock()
        self._over = threading.Event()
        self._threads = [
            threading.Thread(target=work, daemon=True)
            for work in (self._send_chunks, self._send_heartbeats, self._ask_for_weights)
        ]
        self._chunks = camera_chunks(keys.run_id, (name,), config)
        self._inserts = transport.requester(keys.insert(name), _DEADLINE)
        self._questions = transport.requester(keys.latest_weights, _QUESTION_DEADLINE)
        self._heartbeats = transport.publisher(keys.stats("actor", name))
        self._heartbeat = ActorStats(name, "actor", incarnation=1, run_id=keys.run_id).encode()

    def flood(self) -> None:
        """Starts sending, until `stop` is called."""
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """Sends nothing more."""
        self._over.set()

    def counts(self) -> dict[str, float]:
        """Returns the counts since the beginning: what was sent, by kind, and what came back; and
        the seconds of processor time.

        Raises:
            InputError: the flood has ended.
        """
        if not all(thread.is_alive() for thread in self._threads):
            raise InputError("the flood has ended by itself.")
        with self._counting:
            return {**self._counts, "cpu": time.process_time()}

    def _count(self, name: str, number: int = 1) -> None:
        """Adds to a count; answers come in threads of the transport."""
        with self._counting:
            self._counts[name] += number

    def _goes_on(self) -> bool:
        """Whether to send more; waits while it is cut off, when nothing would arrive."""
        while not self._inserts.has_server and not self._over.wait(_OUT):
            pass
        return not self._over.is_set()

    def _send_chunks(self) -> None:
        room = threading.Semaphore(_CHUNKS_UNDER_WAY)

        def hear(answer: Envelope | None) -> None:
            room.release()
            told = "unanswered" if answer is None else Ack.decode(answer.payload).status
            self._count(f"chunks {told}")

        while room.acquire() and self._goes_on():
            payload = next(self._chunks).encode()
            self._count("chunk bytes", len(payload))
            self._count("chunks")
            self._inserts.request(payload).add_done_callback(_heard(hear))

    def _send_heartbeats(self) -> None:
        while self._goes_on():
            self._heartbeats.publish(self._heartbeat)
            self._count("heartbeats")
            time.sleep(_PAUSE)

    def _ask_for_weights(self) -> None:
        room = threading.Semaphore(_QUESTIONS_UNDER_WAY)

        def hear(answer: Envelope | None) -> None:
            room.release()
            self._count("requests answered", answer is not None)

        while room.acquire() and self._goes_on():
            self._count("requests")
            self._questions.request(b"").add_done_callback(_heard(hear))
            time.sleep(_PAUSE)


def _heard(hear: Callable[[Envelope | None], None]) -> Callable[[Future[Envelope]], None]:
    """Returns a callback that passes the answer to ``hear``; None if there is none or a refusal."""

    def settle(future: Future[Envelope]) -> None:
        try:
            answer = future.result()
        except (MessageError, Unanswered):
            answer = None
        hear(answer)

    return guarded("flood", settle)


if __name__ == "__main__":
    serve(Flooder)
