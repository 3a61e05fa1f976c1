"""The learner's main loop, and what happens around it on schedule."""

import math
import shutil
import threading
import time
from collections.abc import Callable

import torch
import zenoh

from common.errors import InputError
from common.process.supervisor import Supervisor
from common.protocol.run_keys import RunKeys
from common.protocol.weights import encode_weights
from common.run.config import RunConfig
from common.run.folder import RunFolder
from learner.algorithm.trainer import Trainer
from learner.checkpoint import load_checkpoint, save_checkpoint
from learner.device import Device
from learner.evaluation.coordinator import EpochTest, EvaluationCoordinator
from learner.prefetch import Prefetched, Prefetcher, to_device
from learner.telemetry.actor_registry import ActorRegistry
from learner.telemetry.gate import GateWatch, least_steps, verdict
from learner.telemetry.held_out import HeldOut
from learner.telemetry.monitor import Monitor
from learner.telemetry.records import Records
from learner.telemetry.run_progress import PhaseEnd, RunProgress
from learner.telemetry.running_means import RunningMeans
from learner.telemetry.sinks.display import Display
from learner.telemetry.sinks.epochs_csv import EpochRow
from learner.telemetry.status import ClockMode, Phase, Status
from replay.chunk_statistics import MOST_FACTS
from replay.interface import Replay

_TICK = 0.1
_LOOK = 0.25
_SHOW = 1.0
_MEASURE_Q = 30.0
_CURVE_POINT = 10.0
_SUMMARY = 60.0
_PUBLISH_AGAIN = 10.0
_ROOM = 2
"""Checkpoints for which there should be room on the disk; tables and snapshots are smaller."""
_LEAST_PHASE = 0.1
"""Share of an epoch below which the last steps of a run are no epoch of their own."""
_FAREWELL = 10.0
"""Seconds that the actors, and then the evaluators, of a finished run have to leave."""


class Learner:
    """One learner process' work: `run` trains until the goal or ``stop``.

    Args:
        steps_goal: agent steps, warm-up included, after which it ends by itself.
        resume: go on from the checkpoint in ``folder``.
        clock: how time passes for local mode's actors.
        gate_minutes: for which a gate may be red before the run ends by itself.
        force: only warn then, and train on.
    """

    def __init__(
        self,
        session: zenoh.Session,
        keys: RunKeys,
        config: RunConfig,
        folder: RunFolder,
        replay: Replay,
        trainer: Trainer,
        device: Device,
        display: Display,
        *,
        steps_goal: int | None,
        resume: bool,
        clock: ClockMode | None,
        gate_minutes: float,
        force: bool,
        stop: threading.Event,
    ) -> None:
        self._config = config
        self._folder = folder
        self._replay = replay
        self._trainer = trainer
        self._device = device
        self._display = display
        self._steps_goal = steps_goal
        self._stop = stop
        self._crew: Supervisor | None = None
        self.failed: str | None = None
        """Why the run ended by itself before its goal: the gate that stayed red."""
        self._red_seconds = 60 * gate_minutes
        self._red_steps = least_steps(config.stream.chunk_steps)
        self._gate_watch = GateWatch(self._red_seconds, self._red_steps)
        self._force = force
        self._warned: set[str] = set()

        self._updates = 0
        self._phase_updates = 0
        self._phase_loss = torch.zeros((), device=device.torch)
        self._phase_began = 0.0
        self._seconds_before = 0.0
        self._published = 0
        self._due: dict[str, float] = {}
        self._started = time.monotonic()

        self._books = RunProgress(config)
        self._gauges = RunningMeans()
        self._roster = ActorRegistry(session, keys)
        self._examiner = EvaluationCoordinator(
            session,
            keys,
            folder.snapshots,
            config.protocol,
            lambda: self._roster.alive("evaluator"),
            self._seconds,
        )
        rows = self._restore() if resume else 0
        self._records = Records(
            folder, config, rows, self._books.agent_steps if resume else None, clock
        )
        self._held_out = HeldOut(folder.held_out)
        self._monitor = Monitor(
            keys,
            config,
            device,
            steps_goal,
            self._books,
            self._roster,
            self._records,
            self._gauges,
            self._examiner,
            self._seconds,
        )
        self._progress = replay.progress(self._books.facts_seen)
        self._weights = session.declare_publisher(
            keys.weights, congestion_control=zenoh.CongestionControl.DROP
        )
        self._publish()
        self._checkpoint()
        self._prefetcher = Prefetcher(
            replay,
            lambda batch: trainer.prepare(to_device(batch, device.torch)),
            config.learning.batch_size,
            self._updates,
        )

    def run(self, crew: Supervisor | None = None) -> None:
        """Train until the goal is reached or ``stop`` is set, and leave everything on disk.

        Args:
            crew: the children of local mode.

        Raises:
            InputError: the loss diverged, the replay has lost what the checkpoint knows of, or
                local mode's children cannot start.
        """
        self._crew = crew
        try:
            self._work(crew)
        finally:
            self._examiner.close()

    def _work(self, crew: Supervisor | None) -> None:
        """All from the first update to the last line of the summary."""
        try:
            self._check_replay()
            self._train()
            if not self._stop.is_set():
                self._conclude()
        except InputError:
            if not self._stop.is_set():
                raise
            # Stopped while it waited for a replay that is away.
        finally:
            self._prefetcher.close()
            if crew is not None:
                crew.ask_to_leave()
            # However it ends, what has been learned is kept; but nothing that has diverged.
            if self._is_finite():
                self._checkpoint()
            self._records.summarise(self._status())
            self._records.close()

    def _check_replay(self) -> None:
        """Refuse a replay that has not what the checkpoint knows of.

        ε and the limiter would begin anew, and every step be played again before the first update.
        The few steps that a power failure may have cost are played again.
        """
        known, found = self._books.agent_steps, self._progress.agent_steps
        if known - found > self._config.replay.learning_starts:
            raise InputError(
                f"the replay has seen {found:,} steps and the checkpoint {known:,}: put the "
                "replay's folder back, or begin another run with this one's network (--run "
                f"ANOTHER --initial {self._folder.checkpoint})."
            )

    def _train(self) -> None:
        """The main loop."""
        while not self._stop.is_set() and not self.done:
            batch = self._prefetcher.next(_TICK)
            if batch is not None:
                self._learn(batch)
            self._look()

    # ------------------------------------------------------------------ one update

    def _learn(self, batch: Prefetched) -> None:
        result = self._trainer.learn(batch.prepared)
        self._updates += 1
        self._phase_updates += 1
        self._phase_loss += result.loss
        self._gauges.add(batch.prepared.batch, result)
        schedule = self._config.learning
        if self._config.replay.sampler == "prioritised":
            self._check_loss()
            self._replay.update_priorities(batch.ids, result.td_errors.abs().cpu().numpy())
        if self._updates % schedule.target_update_period == 0:
            self._trainer.copy_to_target()
        if self._updates % schedule.publish_period == 0:
            self._publish()
        if self._updates % schedule.checkpoint_period == 0:
            self._checkpoint()

    def _is_finite(self) -> bool:
        """Whether all losses of this phase were; one that was not stays in their sum."""
        return math.isfinite(float(self._phase_loss))

    def _check_loss(self) -> None:
        """Before anything of a network that has diverged is kept or told."""
        if not self._is_finite():
            raise InputError(
                f"the loss is no finite number any more at update {self._updates}: begin another "
                "run with a smaller --learning.learning-rate, from this one's last good network "
                f"by --initial {self._folder.checkpoint}."
            )

    def _publish(self) -> None:
        """Broadcast the weights; their version is the number of updates that made them."""
        payload = encode_weights(self._trainer.online)
        self._weights.put(payload, attachment=str(self._updates).encode())
        self._published = self._updates
        self._due["publish"] = time.monotonic() + _PUBLISH_AGAIN

    # ------------------------------------------------------------------ now and then

    def _look(self) -> None:
        """Hear what happened elsewhere, and tell."""
        if not self._is_due("look", _LOOK):
            return
        self._await_room()
        self._check_loss()
        while True:
            self._progress = self._replay.progress(self._books.facts_seen, finished=self._finished)
            for ended in self._books.book(self._progress.facts):
                self._end_phase(ended)
            if len(self._progress.facts) < MOST_FACTS:
                break
        while (test := self._examiner.take_finished()) is not None:
            self._record_test(test)
        if self._crew is not None:
            for note in self._crew.watch(finished=self._finished):
                self._monitor.note(note)
        if self._is_due("measure", _MEASURE_Q):
            self._held_out.measure(self._trainer)
        if self._is_due("publish", _PUBLISH_AGAIN):
            self._publish()  # for a replay that was restarted and has none to give
        status = self._status()
        if status.phase == "training":
            self._watch_gates(status)
        if self._is_due("show", _SHOW):
            self._display.show(status)
        if self._is_due("curves", _CURVE_POINT):
            self._records.point(status)
        if self._is_due("summary", _SUMMARY):
            self._records.summarise(status)

    def _await_room(self) -> None:
        """Pause while the disk is full, or the next checkpoint would end the run."""
        needed = _ROOM * self._folder.checkpoint.stat().st_size
        if shutil.disk_usage(self._folder.path).free >= needed:
            return
        self._display.line(
            f"WARNING: the disk of {self._folder.path} is full: training waits until "
            f"{-(-needed // 2**20)} MiB of it are free."
        )
        while shutil.disk_usage(self._folder.path).free < needed:
            if self._stop.wait(_TICK):
                return
        self._display.line("There is room on the disk again: training goes on.")

    def _watch_gates(self, status: Status) -> None:
        """End the run if a gate stays red."""
        gate = self._gate_watch.look(status.gates, status.agent_steps)
        if gate is None or gate.name in self._warned:
            return
        wrong = verdict(gate, self._red_seconds, self._red_steps)
        if self._force:
            self._warned.add(gate.name)
            self._display.line(f"WARNING: {wrong}; training on because of --force.")
        else:
            self.failed = wrong
            self._stop.set()

    def _is_due(self, what: str, period: float) -> bool:
        now = time.monotonic()
        if now < self._due.get(what, 0.0):
            return False
        self._due[what] = now + period
        return True

    def _status(self) -> Status:
        phase: Phase = "training" if self._books.epoch else "warm-up"
        return self._monitor.status(
            self._progress,
            "finishing" if self._finished else phase,
            self._updates,
            self._published,
            self._held_out.max_q,
        )

    def _seconds(self) -> float:
        """Wall clock of the run."""
        return self._seconds_before + time.monotonic() - self._started

    # ------------------------------------------------------------------ phases and tests

    def _end_phase(self, ended: PhaseEnd) -> None:
        """Record a phase; have the snapshot of an epoch tested."""
        if ended.epoch == 0:
            self._held_out.draw(self._replay, self._config.protocol.held_out_states)
        self._held_out.measure(self._trainer)
        now = self._seconds()
        meanq = self._held_out.max_q[0] if self._held_out.max_q else None
        self._records.add(
            EpochRow.of_games(
                ended.scores,
                epoch=ended.epoch,
                phase="train" if ended.epoch or self._config.exploration.start < 1 else "random",
                steps=ended.steps,
                last_exploration_rate=self._config.epsilon_at(self._books.agent_steps),
                total_train_steps=self._books.train_steps if ended.epoch else 0,
                replay_memory_count=self._progress.stored,
                meanq=meanq,
                meancost=float(self._phase_loss) / max(self._phase_updates, 1),
                weight_updates=self._updates,
                total_time=now,
                epoch_time=now - self._phase_began,
            )
        )
        self._phase_began = now
        self._phase_updates = 0
        self._phase_loss.zero_()
        if ended.epoch:
            test = EpochTest(
                epoch=ended.epoch,
                weight_updates=self._updates,
                total_train_steps=self._books.train_steps,
                replay_memory_count=self._progress.stored,
                meanq=meanq,
                remaining=self._config.protocol.test_steps,
            )
            self._examiner.add(test, encode_weights(self._trainer.online))
        self._checkpoint()
        self._examiner.sweep()

    def _record_test(self, test: EpochTest) -> None:
        now = self._seconds()
        best = max(self._records.rewards("test"), default=None)
        self._records.add(
            EpochRow.of_games(
                test.scores,
                epoch=test.epoch,
                phase="test",
                steps=test.steps,
                last_exploration_rate=self._config.protocol.test_epsilon,
                total_train_steps=test.total_train_steps,
                replay_memory_count=test.replay_memory_count,
                meanq=test.meanq,
                meancost=0.0,
                weight_updates=test.weight_updates,
                total_time=now,
                epoch_time=now - (test.began if test.began is not None else now),
            )
        )
        # First a checkpoint that needs the snapshot no more, then away with it.
        self._checkpoint()
        self._examiner.settle(test, best)

    # ------------------------------------------------------------------ the end

    @property
    def _finished(self) -> bool:
        """Whether all steps are there, and actors may leave."""
        return self._steps_goal is not None and self._books.agent_steps >= self._steps_goal

    @property
    def done(self) -> bool:
        """Whether all steps it was asked for are there, and all updates that they call for."""
        if self._steps_goal is None or not self._finished:
            return False
        steps = self._steps_goal - self._config.replay.learning_starts
        return self._updates >= steps // self._config.learning.train_period

    def _conclude(self) -> None:
        """Let the actors hand in their last chunks, and have the last epoch tested."""
        self._prefetcher.close()
        deadline = time.monotonic() + _FAREWELL
        self._wait_while(lambda: bool(self._roster.alive("actor")) and time.monotonic() < deadline)
        if self._books.phase_steps >= _LEAST_PHASE * self._books.phase_length:
            self._end_phase(self._books.close_phase())
        self._examiner.finish()
        if self._examiner.pending and not self._evaluator_expected():
            self._display.line(
                "No evaluator is there, so epochs stay untested: "
                "start `python -m actors --evaluator` beside the learner next time."
            )
        self._wait_while(lambda: self._examiner.pending > 0 and self._evaluator_expected())
        deadline = time.monotonic() + _FAREWELL
        self._wait_while(
            lambda: bool(self._roster.alive("evaluator")) and time.monotonic() < deadline
        )

    def _evaluator_expected(self) -> bool:
        """Whether one is there, or is a child of local mode that has not joined yet."""
        starting = self._crew is not None and self._crew.works("evaluator")
        return starting or bool(self._roster.alive("evaluator"))

    def _wait_while(self, busy: Callable[[], bool]) -> None:
        self._due.pop("look", None)
        self._look()
        while busy() and not self._stop.is_set():
            self._stop.wait(_TICK)
            self._look()
        self._due.pop("look", None)
        self._look()

    # ------------------------------------------------------------------ what is kept

    def _checkpoint(self) -> None:
        self._check_loss()
        save_checkpoint(
            self._folder.checkpoint,
            self._trainer,
            {
                "updates": self._updates,
                "phase_updates": self._phase_updates,
                "phase_loss": float(self._phase_loss),
                "phase_began": self._phase_began,
                "seconds": self._seconds(),
                "rows": len(self._records.rows),
                "books": self._books.state(),
                "tests": self._examiner.state(),
                "actors": self._roster.state(),
            },
        )

    def _restore(self) -> int:
        """Take up the checkpoint; returns how many rows it knows of."""
        state = load_checkpoint(self._folder.checkpoint, self._trainer)
        self._updates = int(state["updates"])
        self._trainer.go_on(self._updates)
        self._phase_updates = int(state["phase_updates"])
        self._phase_loss += float(state["phase_loss"])
        self._phase_began = float(state["phase_began"])
        self._seconds_before = float(state["seconds"])
        self._books.restore(state["books"])
        self._examiner.restore(state["tests"])
        self._roster.restore(state["actors"])
        return int(state["rows"])
