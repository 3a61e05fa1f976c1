"""The progress of a run's curriculum, computed chunk by chunk from the games played."""

from collections.abc import Sequence
from itertools import islice

from common.settings.config import RunConfig
from replay.chunk_statistics import ChunkStatistics

_RECENT_GAMES = 5
"""Number of games whose mean score is judged. With more, the oldest games belong to another width
of the ranges, and the width oscillates."""


def curriculum_steps(
    config: RunConfig, past: Sequence[ChunkStatistics], agent_steps: int, steps: int
) -> int:
    """Returns the curriculum's steps after a chunk; `RunConfig.difficulty_after` turns them into a
    width.

    Args:
        past: statistics of the earlier chunks, oldest first.
        agent_steps: agent steps of the run, including those of the chunk.
        steps: steps of the chunk.
    """
    learned = max(agent_steps - config.replay.learning_starts, 0)
    learning = config.learning
    if learning.curriculum_score is None:
        return learned
    gone = past[-1].curriculum_steps if past else 0
    games = (game.score for chunk in reversed(past) for game in reversed(chunk.games))
    scores = list(islice(games, _RECENT_GAMES))
    if not scores:
        return gone
    grows = sum(scores) / len(scores) >= learning.curriculum_score
    moved = min(steps, learned)
    return min(max(gone + (moved if grows else -moved), 0), learning.curriculum_steps)
