"""What the replay tells about itself: a line for each accepted chunk, and its own counters.

The learner counts games, staleness and the gates from these facts. They are journaled with the
chunks, so a restart of either side loses none.
"""

from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from common.errors import MessageError
from common.protocol.chunk import Game
from common.protocol.wire import pack, take, unpack

MOST_FACTS = 4_096
"""In one `Progress`."""


@dataclass(frozen=True, slots=True)
class ChunkStatistics:
    """One accepted chunk, without its frames."""

    index: int
    """Order of acceptance: 0, 1, 2 …"""
    agent_steps: int
    """Of the run, this chunk's included."""
    steps: int
    actor: str
    epsilon: float
    weights_version: int
    """Updates that had made the weights it was played with."""
    staleness: int
    """Updates that the learner had begun since, when the chunk arrived."""
    valid: int
    """Steps whose frame showed the screen."""
    matched: int
    """Steps that ended with the commanded keys pressed."""
    games: tuple[Game, ...]
    incarnation: int = 0
    """Start of the actor's process; 0 in a journal written before it was kept."""


class Progress(NamedTuple):
    """The replay at this moment."""

    agent_steps: int
    """Of the run, over all actors."""
    stored: int
    """Steps in the ring."""
    samplable: int
    """Steps that can be drawn."""
    accepted: int
    """Chunks, since the run began; so are the next two."""
    duplicates: int
    refused: int
    throttle: bool
    """Actors are asked to pause."""
    resident_bytes: int
    """Of the process that holds the replay, mapped file pages included."""
    private_bytes: int
    """Of the same process, without file pages."""
    file_bytes: int
    facts: tuple[ChunkStatistics, ...]
    """From the index asked for, at most `MOST_FACTS`: ask again from the last one plus one."""


def facts_to_list(facts: ChunkStatistics) -> list[Any]:
    """Plain values, for msgpack and JSON."""
    games = [list(game) for game in facts.games]
    return [*(getattr(facts, name) for name in _NAMES), games, facts.incarnation]


_NAMES = tuple(field.name for field in fields(ChunkStatistics))[:-2]
_KINDS = (int, int, int, str, float, int, int, int, int, list, int)


def facts_from_list(values: Any) -> ChunkStatistics:
    """The reverse of `facts_to_list`.

    Raises:
        MessageError: other values.
    """
    if isinstance(values, list) and len(values) == len(_KINDS) - 1:
        values = [*values, 0]
    if not isinstance(values, list) or tuple(type(value) for value in values) != _KINDS:
        raise MessageError("not the facts of a chunk")
    *plain_values, games, incarnation = values
    if not all(isinstance(game, list) and [*map(type, game)] == [float, int] for game in games):
        raise MessageError("not the games of a chunk")
    plain = dict(zip(_NAMES, plain_values, strict=True))
    played = tuple(Game(*game) for game in games)
    return ChunkStatistics(**plain, games=played, incarnation=incarnation)


def encode_progress(progress: Progress) -> bytes:
    facts = [facts_to_list(each) for each in progress.facts]
    return pack({**progress._asdict(), "facts": facts})


def decode_progress(payload: bytes) -> Progress:
    """The counters inside ``payload``.

    Raises:
        MessageError: they are not all there.
    """
    message = unpack(payload)
    facts = take(message, "facts", list)
    numbers = {
        name: take(message, name, int, 0)
        for name in Progress._fields
        if name not in ("throttle", "facts")
    }
    return Progress(
        **numbers,
        throttle=take(message, "throttle", bool, -np.inf),
        facts=tuple(facts_from_list(each) for each in facts),
    )
