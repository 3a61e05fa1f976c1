"""`epoch_row`: rows of an epochs' table, for tests to which only some of its columns matter."""

from collections.abc import Sequence
from typing import Any

from common.run.epochs import EpochRow


def epoch_row(scores: Sequence[float] = (), **columns: Any) -> EpochRow:
    """Returns the row of a phase in which games with these scores ended, with plain values
    in all other columns."""
    plain: dict[str, Any] = {
        "epoch": 0,
        "phase": "random",
        "steps": 1_000,
        "last_exploration_rate": 1.0,
        "total_train_steps": 0,
        "replay_memory_count": 0,
        "meanq": None,
        "meancost": None,
        "weight_updates": 0,
        "total_time": 10.0,
        "epoch_time": 10.0,
    }
    return EpochRow.of_games(scores, **plain | columns)
