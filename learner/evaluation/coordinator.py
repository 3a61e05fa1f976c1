"""Splits the test of each epoch's snapshot into shards for the evaluators, and gathers their games.

A state machine without threads of its own. `give_job` and `take_report` answer evaluators, which
ask from other processes through `learner.evaluation.service`; the training loop calls the rest.
"""

import logging
import math
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from common.crc32 import crc32
from common.errors import MessageError
from common.protocol.evaluation import EvaluationJob, EvaluationReport
from common.schedule import Now
from common.settings.config import ProtocolConfig
from learner.evaluation.snapshots import Snapshots, UnusableSnapshot

_log = logging.getLogger(__name__)
NEWCOMER = 5.0
"""Seconds after its job within which an evaluator counts as present, even if its presence is not
known yet."""
MAX_SILENCE = 600.0
"""Seconds without a report after which a present evaluator is given up, if there is another one.
While it plays it reports at least once a minute."""
ABSENCE = 120.0
"""Seconds without any evaluator after which tests are given up: one that has crashed, or lost its
connection, is back before."""
MAX_WAITING = 4
"""Maximum number of tests that wait where there is no evaluator; each keeps a snapshot on disk."""


@dataclass
class EpochTest:
    """One epoch's test, from its snapshot to its last game."""

    epoch: int
    weight_updates: int
    total_train_steps: int
    replay_memory_count: int
    meanq: float | None
    remaining: int
    """Agent steps that no evaluator has been asked to play yet."""
    steps: int = 0
    """Agent steps played."""
    scores: list[float] = field(default_factory=list)
    began: float | None = None
    """Seconds of the run at which the first evaluator got a shard of it."""
    checksum: int | None = None
    """CRC-32 of its snapshot; None in checkpoints of former versions."""


@dataclass
class _Shard:
    """An evaluator's part of a test."""

    epoch: int
    left: int
    given: float
    heard: float
    """Time of the evaluator's last report; before the first one, of the job."""


@dataclass
class EvaluationCoordinator:
    """Coordinates the unfinished tests of a run; safe to call from any thread."""

    snapshots: Snapshots
    protocol: ProtocolConfig
    evaluators: Callable[[], set[str]]
    """Returns the names of the evaluators that are present."""
    seconds: Callable[[], float]
    """Returns the run's time, seconds."""
    now: Now = time.monotonic
    join: str = "ale-robot join"
    """Command that starts a process of the run, without its role."""

    def __post_init__(self) -> None:
        self._lock = threading.Lock()
        self._tests: dict[int, EpochTest] = {}
        self._shards: dict[str, _Shard] = {}
        self._finished: list[EpochTest] = []
        self._taken: list[EpochTest] = []
        """Finished tests that are taken, and not recorded yet."""
        self._unneeded: set[int] = set()
        """Epochs whose snapshots the next `sweep` deletes."""
        self._unread: set[int] = set()
        """Epochs whose snapshots could not be read. People have been told."""
        self._over = False
        self.reports = 0
        """Number of reports that were taken so far."""
        self._present_at = self.now()
        """Time at which there was an evaluator, or this began: they need time to come back."""
        self._missed = False
        """Whether people wait for tests, and have not been told that there is no evaluator."""
        self._backlog = MAX_WAITING
        """Number of waiting tests above which people are told; it doubles, because epochs may take
        a second each."""

    # ------------------------------------------------------------------ for the training loop

    def add(
        self, test: EpochTest, weights: bytes, record: Callable[[], object] = lambda: None
    ) -> None:
        """Queues the test of ``weights``. Where there is no evaluator, only the newest few tests
        wait, and those that have begun.

        Args:
            record: writes the row of the test's epoch. If this or the snapshot cannot be written,
                there is neither row nor test.
        """
        self.snapshots.write(test.epoch, weights)
        record()
        test.checksum = crc32(weights)
        present = self._who_is_present()
        gone = self.now() - self._present_at > ABSENCE
        with self._lock:
            self._tests[test.epoch] = test
            self._unneeded.discard(test.epoch)  # a killed learner may have left its snapshot
            given = {shard.epoch for shard in self._shards.values()}
            waiting = sorted(self._tests.keys() - given)
            unbegun = [epoch for epoch in waiting if not self._tests[epoch].steps]
            given_up = unbegun[:-MAX_WAITING] if gone else []
            for epoch in given_up:
                del self._tests[epoch]
                self._unneeded.add(epoch)
        if given_up and self._missed:  # else a run that wants no tests
            self._missed = False
            _log.warning(
                "epochs up to %d stay untested, because there is no evaluator: start one by `%s "
                "--evaluator`",
                given_up[-1],
                self.join,
            )
        if len(waiting) > self._backlog and present:
            self._backlog = 2 * len(waiting)
            _log.warning(
                "%d tests wait for evaluators, which are slower than the training: start more of "
                "them, or give the next run fewer --protocol.test-steps",
                len(waiting),
            )

    def sweep(self) -> None:
        """Deletes the snapshots of tests that are over or given up; call it once no checkpoint
        needs them."""
        with self._lock:
            unneeded = tuple(self._unneeded)
        for epoch in unneeded:
            self.snapshots.remove(epoch)
            with self._lock:
                self._unneeded.discard(epoch)

    def take_finished(self) -> EpochTest | None:
        """Returns a test that is over, each one once; None if there is none. Call `forget` once
        it is recorded.

        It also takes back the shards of lost evaluators.
        """
        present = self._who_is_present()
        now = self.now()
        with self._lock:
            for name, shard in list(self._shards.items()):
                lost = name not in present and now - shard.given > NEWCOMER
                hangs = now - shard.heard > MAX_SILENCE and len(present) > 1
                if lost or hangs:
                    self._give_back(name)
            if not self._finished:
                return None
            self._taken.append(self._finished.pop(0))
            return self._taken[-1]

    def settle(self, test: EpochTest, best_before: float | None) -> None:
        """Keeps the weights of a finished test if they are the best; `sweep` then deletes its
        snapshot.

        Args:
            best_before: best mean score in the table of epochs. After a resume from the previous
                checkpoint, the table may lack the test of the best snapshot.
        """
        mean = sum(test.scores) / len(test.scores) if test.scores else None
        before = [each for each in (best_before, self.snapshots.best_score()) if each is not None]
        if mean is not None and mean > max(before, default=-math.inf):
            card = {
                "mean_score": mean,
                "games": len(test.scores),
                "epsilon": self.protocol.test_epsilon,
                "train_steps": test.total_train_steps,
                "updates": test.weight_updates,
            }
            text = "the weights of epoch %d, the best so far, are not kept: their snapshot %s"
            try:
                weights = self.snapshots.read(test.epoch, test.checksum)
            except UnusableSnapshot as error:  # or the run would end here
                _log.warning(text, test.epoch, error)
            except OSError as error:
                _log.warning(text, test.epoch, f"cannot be read now, and stays ({error.strerror})")
                return
            else:
                self.snapshots.keep_as_best(test.epoch, weights, card)
        elif not self.snapshots.finish_best(test.epoch):  # as a full disk may have prevented it
            return
        with self._lock:
            self._unneeded.add(test.epoch)

    def forget(self, test: EpochTest) -> None:
        """Drops a finished test from the next checkpoint, once its row is written."""
        with self._lock:
            self._taken.remove(test)

    def finish(self) -> None:
        """Tells evaluators without a job from now on that the run is over."""
        self._over = True

    @property
    def pending(self) -> int:
        """Number of unfinished tests."""
        return len(self._tests)

    @property
    def steps_left(self) -> int:
        """Agent steps of all tests that still have to be played."""
        with self._lock:
            wanted = self.protocol.test_steps
            return sum(max(wanted - test.steps, 0) for test in self._tests.values())

    def state(self) -> list[dict[str, Any]]:
        """Returns the tests whose result has not been recorded yet, of JSON's types.

        Their games are left out, because they are played again.
        """
        with self._lock:
            tests = (*self._taken, *self._finished, *self._tests.values())
            return [asdict(replace(test, scores=[])) for test in tests]

    def restore(self, state: list[dict[str, Any]]) -> list[int]:
        """Resumes the tests of a checkpoint; each is played again from its start.

        The next `sweep` deletes the snapshots that a killed learner left without a test.

        Returns the epochs that stay untested because their snapshots are gone. This happens with
        the previous checkpoint, which has tests that were settled since.
        """
        self.snapshots.finish_best()
        untested = []
        again = {"remaining": self.protocol.test_steps, "steps": 0, "scores": [], "began": None}
        for each in state:
            test = EpochTest(**each | again)
            if not self.snapshots.file(test.epoch).is_file():
                untested.append(test.epoch)
                continue
            with self._lock:
                self._tests[test.epoch] = test
                self._missed = True
        with self._lock:
            self._unneeded |= self.snapshots.epochs() - self._tests.keys()
        return untested

    # ------------------------------------------------------------------ for the evaluators

    def give_job(self, evaluator: str) -> EvaluationJob:
        """Returns the job of an evaluator: its shard of the oldest test, if there is one.

        An evaluator that asks again gives up the shard that it had.
        """
        everyone = len(self._who_is_present() | {evaluator})
        with self._lock:
            if evaluator in self._shards:
                self._give_back(evaluator)
            # A snapshot that cannot be read now holds up no other test.
            left = (each for each in self._tests.values() if each.remaining > 0)
            test = min(left, key=lambda each: each.epoch in self._unread, default=None)
            if test is None:
                return EvaluationJob("finished" if self._over and not self._tests else "wait")
            steps = min(math.ceil(self.protocol.test_steps / everyone), test.remaining)
            test.remaining -= steps
            test.began = self.seconds() if test.began is None else test.began
            now = self.now()
            self._shards[evaluator] = _Shard(test.epoch, steps, given=now, heard=now)
        try:
            weights = self.snapshots.read(test.epoch, test.checksum)
        except UnusableSnapshot as error:
            _log.warning("epoch %d stays untested: its snapshot %s", test.epoch, error)
            self._drop(test.epoch)  # or all later tests would wait for this one
            return EvaluationJob("wait")
        except OSError as error:  # the evaluator asks again, and gives its shard back by that
            if test.epoch not in self._unread:  # evaluators ask twice a second
                self._unread.add(test.epoch)
                _log.warning(
                    "the snapshot of epoch %d cannot be read (%s): its test waits until it can",
                    test.epoch,
                    error.strerror,
                )
            return EvaluationJob("wait")
        self._unread.discard(test.epoch)
        return EvaluationJob("test", test.epoch, steps, self.protocol.test_epsilon, weights)

    def take_report(self, report: EvaluationReport) -> None:
        """Counts what an evaluator has played since its last report.

        Raises:
            MessageError: its shard was given to another evaluator, or is already played.
        """
        with self._lock:
            shard = self._shards.get(report.evaluator)
            test = self._tests.get(report.epoch)
            if shard is None or test is None or shard.epoch != report.epoch:
                raise MessageError("that test was given to somebody else")
            if shard.left <= 0:
                raise MessageError("all its steps are played")
            self.reports += 1
            test.steps += report.steps
            shard.left -= report.steps
            shard.heard = self.now()
            test.scores += [game.score for game in report.games]
            if report.done:
                # With the steps that another process of the same name has left unplayed.
                self._give_back(report.evaluator)

    def _who_is_present(self) -> set[str]:
        if present := self.evaluators():
            self._present_at, self._missed = self.now(), True
        return present

    def _drop(self, epoch: int) -> None:
        with self._lock:
            self._tests.pop(epoch, None)
            self._unneeded.add(epoch)
            for name in [name for name, each in self._shards.items() if each.epoch == epoch]:
                del self._shards[name]

    def _give_back(self, evaluator: str) -> None:
        shard = self._shards.pop(evaluator)
        test = self._tests[shard.epoch]
        test.remaining += max(shard.left, 0)
        busy = any(shard.epoch == test.epoch for shard in self._shards.values())
        if test.remaining == 0 and not busy:
            del self._tests[test.epoch]
            self._finished.append(test)
