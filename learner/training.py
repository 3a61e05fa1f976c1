"""The training loop, `Learner._train`: it samples and updates, and on schedule it publishes,
checkpoints, measures and tests.

`learner.assembly` builds a `Learner` from its parts.
"""

import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from common.counted import counted
from common.errors import InputError
from common.metrics import Value
from common.process.supervisor import Supervisor
from common.protocol.run_status import HealthCheck
from common.registry import SAMPLERS
from common.run.network_file import encode_network_file
from common.schedule import Every
from common.settings.config import RunConfig
from learner.algorithm.interface import Algorithm, Update
from learner.broadcast import Broadcast
from learner.checkpoint import Checkpoint
from learner.evaluation.coordinator import EvaluationCoordinator
from learner.farewell import LOOK_SECONDS, Farewell
from learner.health_guard import HealthGuard
from learner.insist import insist
from learner.loss_guard import LossGuard
from learner.phases import Phases
from learner.prefetch import Prefetched, Prefetcher
from learner.replay_watch import ReplayWatch
from learner.run_clock import RunClock
from learner.telemetry.actor_registry import ActorRegistry
from learner.telemetry.held_out import HeldOut
from learner.telemetry.snapshot import Phase
from learner.telemetry.telemetry import Telemetry
from replay.interface import Replay

_TICK = 0.1
"""Seconds without a minibatch after which the loop does what is due by the clock."""
_MEASURE_SECONDS = 30.0
"""Seconds between two measurements of max-Q on the held-out states."""
_LEAST_PHASE = 0.1
"""Minimum share of an epoch that a run's last steps need to count as an epoch of their own."""
T = TypeVar("T")


@dataclass
class Learner:
    """One learner's work: call `start` once, then `run`."""

    config: RunConfig
    replay: Replay
    algorithm: Algorithm
    draw: Callable[[int], Prefetcher]
    """Starts to draw minibatches; takes the number of updates so far."""
    broadcast: Broadcast
    checkpoint: Checkpoint
    phases: Phases
    losses: LossGuard
    held_out: HeldOut
    evaluation: EvaluationCoordinator
    registry: ActorRegistry
    telemetry: Telemetry
    guard: HealthGuard
    clock: RunClock
    stop: threading.Event
    """Set from outside to end the run, and from inside when the guard ends it."""

    def __post_init__(self) -> None:
        self.failed: str | None = None
        """Why the guard ended the run before its goal."""
        self._prioritised = SAMPLERS.find(self.config.replay.sampler).prioritised
        self._children: Supervisor | None = None
        self._batches: Prefetcher
        self._watch = ReplayWatch(
            self.replay,
            self.phases,
            starts=self.config.replay.learning_starts,
            checkpoint=self.checkpoint.path,
        )
        self._look_schedule = Every(LOOK_SECONDS, self.clock.now)
        self._measure_schedule = Every(_MEASURE_SECONDS, self.clock.now)

    # ------------------------------------------------------------------ the loop

    def run(self, children: Supervisor | None = None) -> None:
        """Trains until the goal is reached or ``stop`` is set, and leaves everything on disk.

        Args:
            children: local mode's actors and evaluators.

        Raises:
            InputError: the loss diverged, or local mode's children cannot start.
        """
        self._children = children
        with ExitStack() as end:  # callbacks run in reverse order, each even if another one fails
            end.callback(lambda: self.telemetry.close(self._values(), self._watch.progress))
            if children is not None:  # so that the last figures include their last chunks
                end.callback(self._watch.look_once_more)
                end.callback(children.close)
            end.callback(self._keep_what_was_learned)
            if children is not None:
                end.callback(children.ask_to_leave)
                end.callback(self.replay.drain)  # lets throttled actors hand in their last chunks
            if self.phases.done:
                tests = ", and tests are left" if self.has_tests_to_come else ""
                self.telemetry.say(
                    f"The run has its {self.phases.steps_goal:,} steps already{tests}: give more "
                    "--steps, or omit the flag, to train on."
                )
            self._batches = self.draw(self.phases.updates)
            end.callback(self._batches.close)
            try:
                self._train()
                if not self.stop.is_set():
                    self._conclude()
            except InputError as error:
                if not self.stop.is_set():
                    # At once: the end of actors and evaluators takes seconds.
                    self.telemetry.say(f"The run ends: {error}")
                    raise
                # The run was stopped while it waited for a replay that is away.

    def _train(self) -> None:
        """Runs the main loop."""
        while not self.stop.is_set() and not self.phases.done:
            batch = self._batches.next(_TICK)
            if batch is not None:
                self._update(batch)
            if self._look_schedule.is_due():
                self._look()

    def _update(self, batch: Prefetched) -> None:
        """Takes one gradient step, and does what is due by the number of updates."""
        result = self.algorithm.update(batch.prepared)
        self.phases.add(result.loss)
        self.telemetry.update(batch.prepared.batch, result)
        updates, learning = self.phases.updates, self.config.learning
        self.losses.add(updates, batch.ids, result)
        if self._prioritised:
            self.losses.check()
            if not self.losses.was_skipped(updates):
                self.replay.update_priorities(batch.ids, self._priorities_of(result))
        if updates % learning.publish_period == 0:
            self._publish()
        if updates % learning.checkpoint_period == 0:
            self._checkpoint()

    def _priorities_of(self, result: Update) -> NDArray[np.float32]:
        """Returns the steps' new priorities. Raises InputError if the algorithm, which may be
        another package's, gives a negative one."""
        priorities: NDArray[np.float32] = result.priorities.cpu().numpy()
        if (priorities < 0).any():
            raise InputError(
                f"the algorithm {self.config.learning.algorithm!r} gives negative priorities: "
                "return magnitudes, from 0 on."
            )
        return priorities

    def _look(self) -> None:
        """Takes in what happened in other processes, and does what is due by the clock."""
        self._insist(self._check_room)
        self.losses.check()
        self._count_chunks()
        self._take_tests()
        if self._children is not None:
            for note in self._children.watch(finished=self._have_all_played):
                self.telemetry.note(note)
        if self._measure_schedule.is_due():
            self.held_out.measure()
        if self.broadcast.is_due():
            self._publish()
        values, progress = self._values(), self._watch.progress
        self._check_health(self._insist(lambda: self.telemetry.report(values, progress)))

    # ------------------------------------------------------------------ start and state

    def restore(self, state: dict[str, Any]) -> None:
        """Continues from the counters of a checkpoint, whose algorithm is already restored. Raises
        InputError if it counts the steps of another replay."""
        self._watch.check_identity(state.get("replay", self._watch.identity))  # older ones lack it
        self.clock.restore(float(state["seconds"]))
        self.phases.restore(state)
        self.algorithm.continue_from(self.phases.updates)
        for epoch in self.evaluation.restore(state["tests"]):
            self.telemetry.say(f"Epoch {epoch} stays untested: its snapshot is missing.")
        self.registry.restore(state["actors"])

    def start(self) -> None:
        """Publishes the first weights and writes a checkpoint.

        Raises:
            InputError: the replay has lost steps that the checkpoint counts.
        """
        # Tells a longer goal too: actors that join now would leave at the former one.
        known, found = self.phases.agent_steps, self._watch.look().agent_steps
        if found - known > self.config.replay.ratio_tolerance:
            more = f"has {found - known:,} steps more than the checkpoint"
            if not known:  # those of a recording
                more = f"begins with {found:,} steps"
            due = round((found - known) * self.config.samples_per_insert)
            updates = counted(due // self.config.learning.batch_size, "update")
            self.telemetry.say(f"The replay {more}: actors wait until {updates} have caught up.")
        self._publish()
        self._save()  # not `_checkpoint`: a disk that is full at the start ends the run

    # ------------------------------------------------------------------ what is kept and sent

    def _insist(self, write: Callable[[], T]) -> T:
        return insist(write, self.telemetry.say, self.stop)

    def _check_room(self) -> None:
        if not self.stop.is_set():  # at a stop, one more checkpoint may just fit
            self.checkpoint.check_room()

    def _checkpoint(self) -> None:
        self._insist(self._save)

    def _save(self) -> None:
        self.losses.check_weights(self.phases.updates)
        self.replay.sync()  # or after a power failure the checkpoint could count lost steps
        self.checkpoint.save(
            {
                **self.phases.state(),
                "replay": self._watch.identity,
                "rows": len(self.telemetry.rows),
                "seconds": self.clock.seconds(),
                "tests": self.evaluation.state(),
                "keeps_snapshots": self.evaluation.snapshots.keep,
                "actors": self.registry.state(),
            }
        )

    def _publish(self) -> None:
        self.losses.check_weights(self.phases.updates)
        self.broadcast.send(self.phases.updates)

    def _keep_what_was_learned(self) -> None:
        """Writes the last checkpoint; raises InputError if the network has diverged."""
        self.losses.check()
        if self.stop.is_set():
            self.telemetry.say("stopping: writing a checkpoint ...")
        self._checkpoint()

    # ------------------------------------------------------------------ phases, tests, health

    def _count_chunks(self) -> None:
        """Counts the chunks that actors have sent since the last look."""
        while True:
            told, seen = self._watch.look(), self.phases.chunks_seen
            new = [chunk for chunk in told.statistics if chunk.index >= seen]
            for chunk in new:
                # Together, so that in a checkpoint at a phase's end both have the same chunks.
                self.registry.accepted(chunk)
                if self.phases.count(chunk):
                    self._end_phase()
            if not new or new[-1].index + 1 >= told.accepted:
                return

    def _have_all_played(self) -> bool:
        """Whether all steps have been played by now. Actors hear of that from the replay, and may
        leave before the next look."""
        if not self.phases.all_played:
            self._count_chunks()
        return self.phases.all_played

    def _end_phase(self) -> None:
        """Records the present phase, and has an epoch's snapshot tested."""
        self._insist(self.held_out.draw)
        self.held_out.measure()
        row, test = self.phases.result(self._watch.progress.stored, self.held_out.mean)
        record = partial(self.telemetry.add, row)
        if row.epoch:
            self.losses.check_weights(self.phases.updates)
            weights = encode_network_file(self.algorithm.published, self.config)
            record = partial(self.evaluation.add, test, weights, record)
        # The last checkpoint is written even if this fails. A resumed run then ends the phase anew.
        self._insist(record)
        self.phases.close(row)
        self._checkpoint()
        self._insist(self.evaluation.sweep)

    def _take_tests(self) -> None:
        while (test := self.evaluation.take_finished()) is not None:
            best = max(self.telemetry.rewards("test"), default=None)
            # First the best weights are kept, then the checkpoint drops the test, then the snapshot
            # is deleted. So an interruption never costs the best weights.
            self._insist(partial(self.evaluation.settle, test, best))
            self._insist(partial(self.telemetry.add, self.phases.end_test(test)))
            self.evaluation.forget(test)
            self._checkpoint()
            self._insist(self.evaluation.sweep)

    def _values(self) -> dict[str, Value]:
        """Returns the figures that only the loop knows."""
        phase: Phase = "training" if self.phases.epoch else "warm-up"
        return {
            "run/phase": "finishing" if self.phases.done else phase,
            "run/seconds": self.clock.seconds(),
            "learning/skipped": self.losses.skipped,
            "stream/weights_version": self.broadcast.version,
            "stream/actors_starting": self._starting,
            "evaluation/steps_left": self.evaluation.steps_left,
        }

    @property
    def _starting(self) -> int:
        """Number of local mode's children that have not joined yet. They take seconds to start."""
        if self._children is None:
            return 0
        # One that is lost has been started again; one that leaves takes a moment to end.
        actors = self.registry.actors()
        joined = {each.stats.name for each in actors if each.alive or each.stats.leaving}
        return len(self._children.at_work() - joined)

    def _check_health(self, checks: Sequence[HealthCheck]) -> None:
        """Ends an unhealthy run, unless it only waits for its last tests."""
        if self.phases.done:
            return
        self.failed = self.guard.check(
            checks if self.phases.epoch else (),
            self.phases.agent_steps,
            self.phases.updates,
            self._watch.stall_reason,
        )
        if self.failed is not None:
            self.stop.set()

    # ------------------------------------------------------------------ the end

    @property
    def has_tests_to_come(self) -> bool:
        """Whether evaluators still have to play: tests are left, or the run's end makes one."""
        return bool(self.evaluation.pending) or self._phase_counts or self._lacks_first_epoch

    @property
    def _phase_counts(self) -> bool:
        """Whether the present phase is an epoch of its own if the run ends now."""
        return self.phases.phase_steps >= _LEAST_PHASE * self.phases.phase_length

    @property
    def _lacks_first_epoch(self) -> bool:
        """Whether all steps were of the warm-up, as where demonstrations have as many as the run:
        an epoch without steps then stands for what they have taught. A learner that was killed
        after the warm-up's end makes it when it is resumed."""
        return self.phases.epoch == 1 and self.phases.phase_steps == 0

    def _conclude(self) -> None:
        """Lets the actors hand in their last chunks, and has the last epoch tested."""
        self._batches.close()
        farewell = Farewell(
            self.evaluation,
            self.registry,
            self._children,
            look=self._look,
            say=self.telemetry.say,
            now=self.clock.now,
            stop=self.stop,
        )
        farewell.wait_for_actors()
        if self._phase_counts:
            self._end_phase()
        if self._lacks_first_epoch:
            self._end_phase()
        farewell.wait_for_evaluators()
