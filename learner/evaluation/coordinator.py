"""Hands each epoch's snapshot to the evaluators and gathers their games."""

import json
import math
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import zenoh
from zenoh.handlers import FifoChannel

from common.errors import InputError, MessageError
from common.protocol.evaluation import EvaluationJob, EvaluationReport
from common.protocol.run_keys import RunKeys
from common.run.config import ProtocolConfig
from common.run.folder import write_atomically

_NEWCOMER = 5.0
"""Seconds after its task in which an evaluator without a liveliness token is not yet given up."""
_MOST_WAITING = 4
"""Tests that wait for the first evaluator; each keeps a snapshot on disk."""
_QUEUE = 256


@dataclass
class EpochTest:
    """One epoch's test, from its snapshot to its last game."""

    epoch: int
    weight_updates: int
    total_train_steps: int
    replay_memory_count: int
    meanq: float | None
    remaining: int
    """Steps that nobody has been asked to play yet."""
    steps: int = 0
    scores: list[float] = field(default_factory=list)
    began: float | None = None
    """Seconds of the run at which the first evaluator took it."""


@dataclass
class _Shard:
    epoch: int
    left: int
    given: float


class EvaluationCoordinator:
    """Serves evaluators from a thread of its own; `take_finished` gives the results.

    Args:
        snapshots: folder for the weights of tests that are not over, and the best so far.
        evaluators: tells the names of the living evaluators.
        seconds: tells the run's time.
    """

    def __init__(
        self,
        session: zenoh.Session,
        keys: RunKeys,
        snapshots: Path,
        protocol: ProtocolConfig,
        evaluators: Callable[[], set[str]],
        seconds: Callable[[], float],
    ) -> None:
        self._protocol = protocol
        self._snapshots = snapshots
        self._evaluators = evaluators
        self._seconds = seconds
        self._lock = threading.Lock()
        self._tests: dict[int, EpochTest] = {}
        self._shards: dict[str, _Shard] = {}
        self._finished: list[EpochTest] = []
        self._given_up: list[int] = []
        self._over = False
        snapshots.mkdir(parents=True, exist_ok=True)
        self._queryables: list[Any] = []
        self._threads: list[threading.Thread] = []
        for key, answer in ((keys.task, self._on_task), (keys.report, self._on_report)):
            queryable = session.declare_queryable(key, FifoChannel(_QUEUE))
            thread = threading.Thread(
                target=_serve, args=(queryable, answer), name="examiner", daemon=True
            )
            thread.start()
            self._queryables.append(queryable)
            self._threads.append(thread)

    def close(self) -> None:
        """Stop answering.

        A thread that still waits for Zenoh when the interpreter ends would bring the process down
        with "FATAL: exception not rethrown".
        """
        for queryable in self._queryables:
            queryable.undeclare()
        for thread in self._threads:
            thread.join()

    def add(self, test: EpochTest, weights: bytes) -> None:
        """Have ``weights`` tested; where nobody tests, only the newest few wait for somebody."""
        write_atomically(self._file(test.epoch), weights)
        nobody = not self._evaluators()
        with self._lock:
            self._tests[test.epoch] = test
            given = {shard.epoch for shard in self._shards.values()}
            waiting = sorted(self._tests.keys() - given)
            for epoch in waiting[:-_MOST_WAITING] if nobody else ():
                del self._tests[epoch]
                self._given_up.append(epoch)

    def sweep(self) -> None:
        """Delete the snapshots of tests that were given up, which no checkpoint needs any more."""
        while self._given_up:
            self._file(self._given_up.pop()).unlink(missing_ok=True)

    def restore(self, state: list[dict[str, Any]]) -> None:
        """Take up the tests of a checkpoint; each is played anew."""
        for each in state:
            test = EpochTest(**each)
            test.remaining, test.steps, test.scores, test.began = (
                self._protocol.test_steps,
                0,
                [],
                None,
            )
            if not self._file(test.epoch).exists():
                raise InputError(
                    f"{self._file(test.epoch)} is missing, which epoch {test.epoch}'s test needs: "
                    "put it back, or start a new run."
                )
            with self._lock:
                self._tests[test.epoch] = test

    def state(self) -> list[dict[str, Any]]:
        """Tests whose result was not taken yet, of JSON's types."""
        with self._lock:
            return [asdict(test) for test in (*self._finished, *self._tests.values())]

    @property
    def pending(self) -> int:
        """Tests that are not over."""
        return len(self._tests)

    @property
    def steps_left(self) -> int:
        """Steps that are still to be played."""
        with self._lock:
            wanted = len(self._tests) * self._protocol.test_steps
            return max(wanted - sum(test.steps for test in self._tests.values()), 0)

    def finish(self) -> None:
        """From now on evaluators for which there is no work are sent home."""
        self._over = True

    def take_finished(self) -> EpochTest | None:
        """A test that is over, once; also notices evaluators that were lost."""
        living = self._evaluators()
        now = time.monotonic()
        with self._lock:
            for name, shard in list(self._shards.items()):
                if name not in living and now - shard.given > _NEWCOMER:
                    self._give_back(name)
            return self._finished.pop(0) if self._finished else None

    def settle(self, test: EpochTest, best_before: float | None) -> None:
        """Drop the snapshot of a test that is recorded, unless it is the best so far."""
        snapshot = self._file(test.epoch)
        mean = sum(test.scores) / len(test.scores) if test.scores else None
        if mean is not None and (best_before is None or mean > best_before):
            snapshot.replace(self._snapshots / "best.safetensors")
            card = {
                "epoch": test.epoch,
                "mean_score": mean,
                "games": len(test.scores),
                "epsilon": self._protocol.test_epsilon,
                "train_steps": test.total_train_steps,
                "updates": test.weight_updates,
            }
            write_atomically(self._snapshots / "best.json", json.dumps(card, indent=2).encode())
        else:
            snapshot.unlink(missing_ok=True)

    def _file(self, epoch: int) -> Path:
        return self._snapshots / f"epoch-{epoch:04d}.safetensors"

    def _on_task(self, payload: bytes) -> bytes:
        name = payload[:200].decode(errors="replace")
        everyone = len(self._evaluators() | {name})
        with self._lock:
            if name in self._shards:
                self._give_back(name)  # it asks again, so it has given up what it had
            for test in self._tests.values():
                if test.remaining > 0:
                    share = math.ceil(self._protocol.test_steps / everyone)
                    shard = min(share, test.remaining)
                    test.remaining -= shard
                    test.began = self._seconds() if test.began is None else test.began
                    self._shards[name] = _Shard(test.epoch, shard, time.monotonic())
                    break
            else:
                over = self._over and not self._tests
                return EvaluationJob("finished" if over else "wait").encode()
        weights = self._file(test.epoch).read_bytes()
        return EvaluationJob(
            "test", test.epoch, shard, self._protocol.test_epsilon, weights
        ).encode()

    def _on_report(self, payload: bytes) -> bytes:
        report = EvaluationReport.decode(payload)
        with self._lock:
            shard = self._shards.get(report.evaluator)
            test = self._tests.get(report.epoch)
            if shard is None or test is None or shard.epoch != report.epoch:
                raise MessageError("that test was given to somebody else")
            test.steps += report.steps
            shard.left -= report.steps
            test.scores += [game.score for game in report.games]
            if report.done:
                del self._shards[report.evaluator]
                self._close_if_done(test)
        return b"ok"

    def _give_back(self, name: str) -> None:
        shard = self._shards.pop(name)
        test = self._tests[shard.epoch]
        test.remaining += max(shard.left, 0)
        self._close_if_done(test)

    def _close_if_done(self, test: EpochTest) -> None:
        busy = any(shard.epoch == test.epoch for shard in self._shards.values())
        if test.remaining == 0 and not busy:
            del self._tests[test.epoch]
            self._finished.append(test)


def _serve(queryable: Any, answer: Callable[[bytes], bytes]) -> None:
    for query in queryable:
        with query:
            payload = query.payload.to_bytes() if query.payload is not None else b""
            try:
                query.reply(query.key_expr, answer(payload))
            except MessageError as error:
                query.reply_err(str(error).encode())
