"""The phases of a run: the warm-up (epoch 0), one epoch after another, and the tests of their
snapshots."""

from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from common.metrics import Value
from common.protocol.run_keys import DEMONSTRATIONS
from common.run.epochs import EpochRow
from common.settings.config import RunConfig
from common.settings.hands import keys_can_follow, latest_play
from learner.evaluation.coordinator import EpochTest
from learner.faulty_environments import FaultyEnvironments
from learner.run_clock import RunClock
from replay.chunk_statistics import ChunkStatistics

if TYPE_CHECKING:  # as in `learner.device`
    from torch import Tensor

RECENT_GAMES = 50
"""Number of newest training games of which the mean score is told."""
RECENT_CHUNKS = 500
"""Number of newest chunks of which the staleness is told."""
JUDGED_CHUNKS = 80
"""Number of newest chunks that health checks judge: a fault that is over must not count for
long."""


class Phases:
    """Counts the run's steps, games and updates by phase, and makes the rows of their table.

    Steps and games depend only on the statistics of chunks, in the order of their acceptance.
    """

    def __init__(self, config: RunConfig, clock: RunClock, steps_goal: int | None = None) -> None:
        """Takes the run's settings, its time, and the agent steps with which it ends, if any."""
        self._config = config
        self._clock = clock
        self.steps_goal = steps_goal
        self.chunks_seen = 0
        """Index of the next chunk to count."""
        self.agent_steps = 0
        self.games = 0
        """Games that ended after the warm-up."""
        self.updates = 0
        self.epoch = 0
        """The present phase; 0 during the warm-up."""
        self.phase_steps = 0
        self._scores: list[float] = []
        self._phase_updates = 0
        self._loss: Tensor | float = 0.0  # a sum on the device, so that no update waits for it
        self._began = 0.0
        self._last_steps: int | None = None
        """Agent steps of the phase before; None after a restart."""
        self._recent_scores: deque[float] = deque(maxlen=RECENT_GAMES)
        self._recent_chunks: deque[ChunkStatistics] = deque(maxlen=RECENT_CHUNKS)
        self._faulty_environments = FaultyEnvironments(
            keys_can_follow=keys_can_follow(latest_play(config))
        )

    # ------------------------------------------------------------------ counting

    def count(self, chunk: ChunkStatistics) -> bool:
        """Counts the next chunk; returns whether the phase is now complete.

        A chunk belongs as a whole to the phase in which it arrives. Demonstrations never end a
        phase: if they are longer than the warm-up, they make it longer.
        """
        self.chunks_seen = chunk.index + 1
        self.phase_steps += chunk.agent_steps - self.agent_steps  # with chunks whose data is gone
        self.agent_steps = chunk.agent_steps
        scores = [game.score for game in chunk.games]
        self._scores += scores
        if self.epoch:
            self.games += len(scores)
            self._recent_scores.extend(scores)
        self._recent_chunks.append(chunk)
        self._faulty_environments.add(chunk)
        return self.phase_steps >= self.phase_length and chunk.actor != DEMONSTRATIONS

    def add(self, loss: "Tensor") -> None:
        """Counts one update; a ``loss`` that is not finite counts as 0."""
        self.updates += 1
        self._phase_updates += 1
        self._loss += loss.float().nan_to_num(0.0, 0.0, 0.0)

    @property
    def phase_length(self) -> int:
        """Agent steps of the present phase once it is complete."""
        config = self._config
        return config.protocol.epoch_steps if self.epoch else config.replay.learning_starts

    @property
    def steps_left(self) -> int:
        """Agent steps until the present phase ends, which the end of the run may cut short."""
        left = max(self.phase_length - self.phase_steps, 0)
        if self.steps_goal is None:
            return left
        return min(left, max(self.steps_goal - self.agent_steps, 0))

    @property
    def all_played(self) -> bool:
        """Whether all requested steps have been played, so that actors may leave."""
        return self.steps_goal is not None and self.agent_steps >= self.steps_goal

    @property
    def done(self) -> bool:
        """Whether all requested steps have been played, and all their updates made."""
        if self.steps_goal is None or not self.all_played:
            return False
        steps = self.steps_goal - self._config.replay.learning_starts
        return self.updates >= steps // self._config.learning.train_period

    @property
    def random_reward(self) -> float | None:
        """Mean score of the warm-up's games so far, if they are random; None after the warm-up."""
        return float(np.mean(self._scores)) if self._is_random and self._scores else None

    @property
    def _is_random(self) -> bool:
        """Whether the present phase plays at random."""
        return not self.epoch and self._config.exploration.start == 1

    @property
    def train_steps(self) -> int:
        """Agent steps without the warm-up."""
        return max(self.agent_steps - self._config.replay.learning_starts, 0)

    # ------------------------------------------------------------------ what came of them

    def result(self, stored: int, meanq: float | None) -> tuple[EpochRow, EpochTest]:
        """Returns what came of the present phase, complete or not; `close` then ends it.

        Args:
            stored: steps in the replay.
            meanq: mean max-Q over the held-out states.

        Returns:
            The phase's row, and the test of its snapshot, which only an epoch has.
        """
        config = self._config
        test = EpochTest(
            epoch=self.epoch,
            weight_updates=self.updates,
            total_train_steps=self.train_steps if self.epoch else 0,
            replay_memory_count=stored,
            meanq=meanq,
            remaining=config.protocol.test_steps,
        )
        row = _row(
            test,
            self._scores,
            self._began,
            self._clock.seconds(),
            phase="random" if self._is_random else "train",
            steps=self.phase_steps,
            last_exploration_rate=config.epsilon_at(self.agent_steps),
            meancost=float(self._loss) / max(self._phase_updates, 1),
        )
        return row, test

    def close(self, row: EpochRow) -> None:
        """Ends the present phase at the time of its ``row``, which is written, and begins the next
        one."""
        self.epoch += 1
        self._last_steps = self.phase_steps
        self.phase_steps = self._phase_updates = 0
        self._scores, self._loss, self._began = [], 0.0, row.total_time

    def end_test(self, test: EpochTest) -> EpochRow:
        """Returns the row of a test that is over."""
        now = self._clock.seconds()
        return _row(
            test,
            test.scores,
            now if test.began is None else test.began,
            now,
            phase="test",
            steps=test.steps,
            last_exploration_rate=self._config.protocol.test_epsilon,
            meancost=0.0,
        )

    def values(self) -> dict[str, Value]:
        """Returns how far the run is, and what its recent games and chunks were like. If it has all
        its steps, and they end between two phases, the phase is the last epoch, complete."""
        ended = self.all_played and not self.phase_steps
        steps_now, left = self.phase_steps, self.steps_left
        if ended:
            steps_now, left = self._last_steps or self.phase_length, 0
        chunks, scores = list(self._recent_chunks), self._recent_scores
        p50, p95 = (
            np.percentile([each.staleness for each in chunks], (50, 95)).tolist()
            if chunks
            else (None, None)
        )
        judged = chunks[-JUDGED_CHUNKS:]
        steps = sum(each.steps for each in judged)
        samples = self.updates * self._config.learning.batch_size
        return {
            "run/epoch": self.epoch - ended,
            "run/phase_length": steps_now + left,
            "run/phase_steps": steps_now,
            "learning/updates": self.updates,
            "learning/epsilon": self._config.epsilon_at(self.agent_steps),
            "learning/rate": self._config.learning.learning_rate_at(self.updates),
            "play/games": self.games,
            "play/train_reward": sum(scores) / len(scores) if scores else None,
            "play/valid_frame_share": sum(e.valid for e in judged) / steps if steps else None,
            "play/following_frame_share": sum(e.follows for e in judged) / steps if steps else None,
            "play/press_match_share": sum(e.matched for e in judged) / steps if steps else None,
            **self._faulty_environments.values(),
            "stream/staleness_p50": p50,
            "stream/staleness_p95": p95,
            "stream/samples_per_insert": samples / self.train_steps if self.train_steps else None,
        }

    # ------------------------------------------------------------------ checkpoints

    _COUNTERS = ("agent_steps", "epoch", "phase_steps", "games")
    """Counters of every checkpoint; one that is newer than 0.1.0 is read by `dict.get` instead."""

    def state(self) -> dict[str, Any]:
        """Returns all counters, of JSON's types."""
        return {
            "updates": self.updates,
            "phase_updates": self._phase_updates,
            "phase_loss": float(self._loss),
            "phase_began": self._began,
            "books": {
                "facts_seen": self.chunks_seen,
                **{name: getattr(self, name) for name in self._COUNTERS},
                "phase_scores": self._scores,
                "recent_scores": list(self._recent_scores),
            },
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continues from what `state` returned."""
        self.updates = int(state["updates"])
        self._phase_updates = int(state["phase_updates"])
        self._loss = float(state["phase_loss"])
        self._began = float(state["phase_began"])
        books = state["books"]
        self.chunks_seen = int(books["facts_seen"])
        for name in self._COUNTERS:
            setattr(self, name, int(books[name]))
        self._scores = [float(score) for score in books["phase_scores"]]
        self._recent_scores.extend(float(score) for score in books["recent_scores"])


def _row(
    epoch: EpochTest, scores: Sequence[float], began: float, ended: float, **columns: Any
) -> EpochRow:
    """Returns a row with the ``scores`` of its games, the columns of ``epoch``, and ``columns``."""
    return EpochRow.of_games(
        scores,
        epoch=epoch.epoch,
        total_train_steps=epoch.total_train_steps,
        replay_memory_count=epoch.replay_memory_count,
        meanq=epoch.meanq,
        weight_updates=epoch.weight_updates,
        total_time=ended,
        epoch_time=ended - began,
        **columns,
    )
