"""What the replay tells about itself: a line for each accepted chunk, and its own counters.

The learner counts games, staleness and the health checks from these statistics. They are journaled
with the chunks, so a restart of either side loses none.
"""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

from annotated_types import MaxLen

from common.checked import Count, Fraction, Rows
from common.metrics import Value
from common.protocol.chunk import Game
from common.protocol.message import Message
from common.version import VERSION

MAX_STATISTICS = 4_096
"""In one `Progress`."""
MAX_GAMES = 16_384
"""Maximum number of games in all statistics of one `Progress`. It keeps the message below the
number of values that `common.protocol.wire` accepts."""


class ChunkStatistics(NamedTuple):
    """One accepted chunk, without its frames."""

    index: Count  # type: ignore[assignment]  # hides a method of tuples
    """Order of acceptance: 0, 1, 2 …"""
    agent_steps: Count
    """Agent steps of the run, this chunk's included."""
    steps: Count
    actor: str
    epsilon: Fraction
    weights_version: Count
    """Updates that had made the weights it was played with."""
    staleness: Count
    """Updates that the learner had begun since, when the chunk arrived."""
    valid: Count
    """Steps whose frame showed the screen."""
    matched: Count
    """Steps that ended with the commanded keys pressed."""
    games: Rows[Game]
    incarnation: Count = 0
    """Start of the actor's process; 0 in a journal written before it was kept."""
    follows: Count = 0
    """Steps whose frame changed with the game; 0 likewise."""
    curriculum_steps: Count = 0
    """Steps that the curriculum has gone on by then, those that it went back taken off; 0
    likewise."""


@dataclass(frozen=True)
class Progress(Message):
    """The replay at this moment."""

    agent_steps: Count
    """Agent steps of the run, over all actors."""
    stored: Count
    """Steps in the ring."""
    samplable: Count
    """Steps that can be drawn."""
    accepted: Count
    """Chunks, since the run began; so are the next two."""
    duplicates: Count
    refused: Count
    throttle: bool
    """Actors are asked to pause."""
    resident_bytes: Count
    """Memory of the process that holds the replay, mapped file pages included."""
    private_bytes: Count
    """Memory of the same process, without file pages."""
    file_bytes: Count
    statistics: Annotated[Rows[ChunkStatistics], MaxLen(MAX_STATISTICS)]
    """From the index asked for, as many as one message holds (`MAX_STATISTICS`, `MAX_GAMES`): ask
    again from the last one plus one."""
    run_id: str = ""
    """Identity of the run."""
    version: str = VERSION
    """Version of the software of the process that holds the replay."""
    over_quota: Count = 0
    """Messages of actors that were turned away for the time being, since that process began."""
    shut_out: Count = 0
    """Connections since then of processes that may do nothing at its hub."""
    difficulty: Fraction = 1.0
    """Share of their widths that the ranges of `randomise` have in the next game."""

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
