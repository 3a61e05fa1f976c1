"""Counts the run's steps and games into phases: warm-up (epoch 0), then one epoch after another."""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from common.metrics import Value
from common.run.config import RunConfig
from replay.chunk_statistics import ChunkStatistics

RECENT_GAMES = 50
RECENT_CHUNKS = 500
JUDGED_CHUNKS = 80
"""Newest chunks that health checks judge: a fault that is over must not count for long."""


class PhaseEnd(NamedTuple):
    """A phase that is complete."""

    epoch: int
    """0: the random policy of the warm-up."""
    steps: int
    scores: tuple[float, ...]


class _Recent(NamedTuple):
    steps: int
    staleness: int
    valid: int
    matched: int


@dataclass
class RunProgress:
    """What follows from the facts of chunks alone, in the order in which they were accepted."""

    config: RunConfig
    facts_seen: int = 0
    """Index of the next chunk to book."""
    agent_steps: int = 0
    epoch: int = 0
    """The phase that is going on; 0 during the warm-up."""
    phase_steps: int = 0
    phase_scores: list[float] = field(default_factory=list)
    games: int = 0
    """Games that ended after the warm-up."""
    recent_scores: deque[float] = field(default_factory=lambda: deque(maxlen=RECENT_GAMES))
    _recent: deque[_Recent] = field(default_factory=lambda: deque(maxlen=RECENT_CHUNKS))

    def book(self, facts: Iterable[ChunkStatistics]) -> Iterator[PhaseEnd]:
        """Count chunks; yields each phase that one of them completes, before going on.

        A chunk belongs whole to the phase in which it arrives.
        """
        for chunk in facts:
            if chunk.index < self.facts_seen:
                continue
            self.facts_seen = chunk.index + 1
            self.agent_steps = chunk.agent_steps
            self.phase_steps += chunk.steps
            scores = [game.score for game in chunk.games]
            self.phase_scores += scores
            if self.epoch:
                self.games += len(scores)
                self.recent_scores.extend(scores)
            self._recent.append(_Recent(chunk.steps, chunk.staleness, chunk.valid, chunk.matched))
            if self.phase_steps >= self.phase_length:
                yield self.close_phase()

    def close_phase(self) -> PhaseEnd:
        """End the present phase, complete or not, and begin the next."""
        ended = PhaseEnd(self.epoch, self.phase_steps, tuple(self.phase_scores))
        self.epoch += 1
        self.phase_steps = 0
        self.phase_scores = []
        return ended

    @property
    def phase_length(self) -> int:
        """Agent steps of the present phase when it is complete."""
        return (
            self.config.protocol.epoch_steps if self.epoch else self.config.replay.learning_starts
        )

    @property
    def train_steps(self) -> int:
        """Agent steps without the warm-up."""
        return max(self.agent_steps - self.config.replay.learning_starts, 0)

    def values(self, *, finishing: bool) -> dict[str, Value]:
        """Returns where the run is, and what its recent games and chunks were like.

        Args:
            finishing: only tests are left. Between two phases at the very end, the last epoch is
                told, whole.
        """
        ended = finishing and not self.phase_steps
        chunks, scores = list(self._recent), self.recent_scores
        judged = chunks[-JUDGED_CHUNKS:]
        steps = sum(each.steps for each in judged)
        p50, p95 = (
            np.percentile([each.staleness for each in chunks], (50, 95)).tolist()
            if chunks
            else (None, None)
        )
        return {
            "run/agent_steps": self.agent_steps,
            "run/epoch": self.epoch - ended,
            "run/phase_length": self.phase_length,
            "run/phase_steps": self.phase_length if ended else self.phase_steps,
            "learning/epsilon": self.config.epsilon_at(self.agent_steps),
            "play/games": self.games,
            "play/train_reward": sum(scores) / len(scores) if scores else None,
            "play/valid_frame_share": sum(e.valid for e in judged) / steps if steps else None,
            "play/press_match_share": sum(e.matched for e in judged) / steps if steps else None,
            "stream/staleness_p50": p50,
            "stream/staleness_p95": p95,
        }

    _COUNTERS = ("facts_seen", "agent_steps", "epoch", "phase_steps", "games")

    def state(self) -> dict[str, Any]:
        """Everything, of JSON's types."""
        return {name: getattr(self, name) for name in self._COUNTERS} | {
            "phase_scores": self.phase_scores,
            "recent_scores": list(self.recent_scores),
        }

    def restore(self, state: dict[str, Any]) -> None:
        for name in self._COUNTERS:
            setattr(self, name, int(state[name]))
        self.phase_scores = [float(score) for score in state["phase_scores"]]
        self.recent_scores.extend(float(score) for score in state["recent_scores"])
