"""The replay's reports: statistics of each accepted chunk, and the replay's own counters.

The learner computes games, staleness and health checks from the statistics. They are journaled with
the chunks, so a restart of either side loses none.
"""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

from annotated_types import MaxLen

from common.checked import Count, Fraction, LongText, Rows
from common.metrics import Value
from common.protocol.chunk import Game
from common.protocol.message import Message
from common.version import VERSION

MAX_STATISTICS = 4_096
"""Maximum number of statistics in one `ReplayProgress`."""
MAX_GAMES = 16_384
"""Maximum number of games in all statistics of one `ReplayProgress`. It keeps the message below the
number of values that `common.protocol.wire` accepts."""


class ChunkStatistics(NamedTuple):
    """The statistics of one accepted chunk."""

    index: Count  # type: ignore[assignment]  # hides a method of tuples
    """Order of acceptance: 0, 1, 2 …"""
    agent_steps: Count
    """Agent steps of the run, including this chunk's."""
    steps: Count
    actor: str
    epsilon: Fraction
    weights_version: Count
    """Version of the weights that played it."""
    staleness: Count
    """Number of updates between those weights and the arrival of the chunk, as the learner began
    them."""
    valid: Count
    """Number of steps whose frame showed the game."""
    matched: Count
    """Number of steps that ended with the commanded keys pressed."""
    games: Rows[Game]
    incarnation: Count = 0
    """Incarnation of the actor's process. This field and the next ones are 0 in journals that
    were written before the field existed."""
    follows: Count = 0
    """Number of steps whose frame changed with the game."""
    curriculum_steps: Count = 0
    """Net number of steps by which the curriculum had advanced."""
    stream: Count = 0
    """Number of the actor's environment."""


@dataclass(frozen=True)
class ReplayProgress(Message):
    """The state of the replay at one moment."""

    agent_steps: Count
    """Agent steps of the run, over all actors."""
    stored: Count
    """Number of steps in the ring."""
    samplable: Count
    """Number of steps that can be drawn."""
    accepted: Count
    """Number of chunks accepted since the run began."""
    duplicates: Count
    """Number of duplicate chunks since the run began."""
    refused: Count
    """Number of chunks refused since the run began."""
    throttle: bool
    """Whether actors are asked to pause."""
    resident_bytes: Count
    """Memory of the process that holds the replay, mapped file pages included."""
    private_bytes: Count
    """Memory of the same process, without file pages."""
    file_bytes: Count
    statistics: Annotated[Rows[ChunkStatistics], MaxLen(MAX_STATISTICS)]
    """Statistics from the requested index on, as many as one message holds (`MAX_STATISTICS`,
    `MAX_GAMES`). To get more, ask again from the last index plus one."""
    run_id: str = ""
    """Identity of the run."""
    version: str = VERSION
    """Software version of the process that holds the replay."""
    over_quota: Count = 0
    """Number of actors' messages that must be sent again, over quota or in spite of the throttle,
    since that process began."""
    shut_out: Count = 0
    """Number of connections by processes that its hub does not admit, since that process began."""
    difficulty: Fraction = 1.0
    """Share of their full widths that the ranges of `randomise` have in the next game."""
    failed: LongText = ""
    """What the sampler did wrong, in a sentence: nothing can be drawn any more; empty while it
    works."""

    def values(self) -> dict[str, Value]:
        """Returns the figures by their keys in `common.metrics`."""
        return {
            "run/agent_steps": self.agent_steps,
            "play/difficulty": self.difficulty,
            "stream/stored": self.stored,
            "stream/samplable": self.samplable,
            "stream/throttled": int(self.throttle),
            "stream/chunks_acked": self.accepted,
            "stream/chunks_duplicate": self.duplicates,
            "stream/chunks_refused": self.refused,
            "stream/over_quota": self.over_quota,
            "stream/shut_out": self.shut_out,
            "replay/private_bytes": self.private_bytes,
            "replay/resident_bytes": self.resident_bytes,
            "replay/file_bytes": self.file_bytes,
        }
