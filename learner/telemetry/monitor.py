"""Puts together what everybody knows into one `Status`."""

import time
from collections import deque
from collections.abc import Callable

from common.protocol.run_keys import RunKeys
from common.run.config import RunConfig
from learner.device import Device
from learner.evaluation.coordinator import EvaluationCoordinator
from learner.telemetry.actor_registry import ActorRegistry
from learner.telemetry.health_checks import judge_gates
from learner.telemetry.recent_latency import RecentLatency
from learner.telemetry.records import Records
from learner.telemetry.run_progress import RunProgress
from learner.telemetry.running_means import RunningMeans
from learner.telemetry.status import ChunkCounts, Phase, Status
from replay.chunk_statistics import Progress

_RATE_WINDOW = 15.0
_NOTES = 20


class Monitor:
    """Derives rates, remaining times and gates; changes nothing.

    Args:
        seconds: tells the run's time, those before a resume included.
    """

    def __init__(
        self,
        keys: RunKeys,
        config: RunConfig,
        device: Device,
        steps_goal: int | None,
        books: RunProgress,
        roster: ActorRegistry,
        records: Records,
        gauges: RunningMeans,
        examiner: EvaluationCoordinator,
        seconds: Callable[[], float],
    ) -> None:
        self._keys = keys
        self._config = config
        self._device = device
        self._steps_goal = steps_goal
        self._books = books
        self._roster = roster
        self._records = records
        self._gauges = gauges
        self._examiner = examiner
        self._seconds = seconds
        self._ticks: deque[tuple[float, int, int]] = deque()
        self._key_delays = RecentLatency()
        self._notes: deque[str] = deque(maxlen=_NOTES)

    def note(self, text: str) -> None:
        """Remember an event for the display."""
        self._notes.append(text)

    def status(
        self,
        progress: Progress,
        phase: Phase,
        updates: int,
        weights_version: int,
        max_q: tuple[float, float] | None,
    ) -> Status:
        """The run now.

        Args:
            max_q: mean and standard deviation over the held-out states; None before there are any.
        """
        config, books = self._config, self._books
        for text in self._roster.take_notes():
            self.note(text)
        steps_rate, updates_rate = self._rates(updates)
        loss, squared_error, reward_variance, pixels = self._gauges.read() or (None,) * 4
        made, retried = self._roster.counts()
        # A process that was killed could not say its last counts; the replay knows what came.
        made = max(made, progress.accepted + progress.refused)
        mean_max_q, deviation = max_q or (None, None)
        valid, matched = books.share("valid"), books.share("matched")
        delays = self._key_delays
        delays.look(self._roster.key_times())
        press = delays.of_late("press")
        # Between two phases at the very end: the last epoch, whole.
        ended = phase == "finishing" and not books.phase_steps
        tests = [row for row in self._records.rows if row.phase == "test"]
        test_history = self._records.rewards("test")
        return Status(
            run=self._keys.run,
            preset=config.preset,
            env=config.env,
            game=config.game,
            device=self._device.name,
            phase=phase,
            elapsed=self._seconds(),
            remaining=self._remaining(phase, steps_rate),
            agent_steps=books.agent_steps,
            steps_goal=self._steps_goal,
            warmup=config.replay.learning_starts,
            warmup_done=min(books.agent_steps, config.replay.learning_starts),
            epoch=books.epoch - ended,
            epoch_steps=config.protocol.epoch_steps,
            epoch_done=config.protocol.epoch_steps if ended else books.phase_steps,
            epsilon=config.epsilon_at(books.agent_steps),
            updates=updates,
            loss=loss,
            mean_max_q=mean_max_q,
            held_out_std=deviation,
            games=books.games,
            train_reward=books.train_reward(),
            test_reward=test_history[-1] if test_history else None,
            test_epoch=tests[-1].epoch if tests else None,
            random_reward=next(iter(self._records.rewards("random")), None),
            train_history=self._records.rewards("train"),
            test_history=test_history,
            steps_per_second=steps_rate,
            updates_per_second=updates_rate,
            samples_per_insert=(
                updates * config.learning.batch_size / books.train_steps
                if books.train_steps
                else None
            ),
            samples_per_insert_goal=config.samples_per_insert,
            staleness_p50=books.staleness(50),
            staleness_p95=books.staleness(95),
            weights_version=weights_version,
            stored=progress.stored,
            capacity=config.replay.capacity,
            replay_private_bytes=progress.private_bytes,
            replay_resident_bytes=progress.resident_bytes,
            replay_file_bytes=progress.file_bytes,
            time=self._roster.time(),
            chunks=ChunkCounts(
                made=made,
                acked=progress.accepted,
                retried=retried,
                duplicate=progress.duplicates,
                refused=progress.refused,
            ),
            valid_frame_share=valid,
            press_match_share=matched,
            press=press,
            release=delays.of_late("release"),
            press_in_all=delays.in_all("press"),
            release_in_all=delays.in_all("release"),
            actors=self._roster.actors(),
            gates=judge_gates(
                env=config.env,
                valid_frame_share=valid,
                pixel_deviation=pixels,
                max_q_deviation=deviation,
                # Before it has explored, a network cannot be better than a blind one.
                squared_td_error=(
                    squared_error if books.train_steps >= config.exploration.steps else None
                ),
                reward_variance=reward_variance,
                press_match_share=matched,
                press=press,
                play=config.play,
                refused_chunks=progress.refused,
            ),
            notes=tuple(self._notes),
        )

    def _rates(self, updates: int) -> tuple[float | None, float | None]:
        """Agent steps and updates per second over the last while."""
        now = time.monotonic()
        self._ticks.append((now, self._books.agent_steps, updates))
        while now - self._ticks[0][0] > _RATE_WINDOW:
            self._ticks.popleft()
        then, steps, before = self._ticks[0]
        if now - then < 1:
            return None, None
        return (self._books.agent_steps - steps) / (now - then), (updates - before) / (now - then)

    def _remaining(self, phase: Phase, steps_rate: float | None) -> float | None:
        """Seconds to the end of the phase, or of the tests when only they are left."""
        if phase == "finishing":
            rate = sum(
                actor.steps_per_second
                for actor in self._roster.actors()
                if actor.role == "evaluator"
            )
            return self._examiner.steps_left / rate if rate else None
        left = max(self._books.phase_length - self._books.phase_steps, 0)
        return left / steps_rate if steps_rate else None
