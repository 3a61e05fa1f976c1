"""What learner and evaluators say to each other: which weights to test, and how the games went."""

from typing import Any, Literal, NamedTuple, cast

from common.errors import MessageError
from common.protocol.chunk import Game, take_games
from common.protocol.wire import pack, take, unpack

MAX_GAMES = 10_000


class Task(NamedTuple):
    """The learner's answer to an evaluator that asks for work."""

    kind: Literal["test", "wait", "finished"]
    epoch: int = 0
    steps: int = 0
    """Decisions to play, then to the end of the first game if none has ended."""
    epsilon: float = 0.0
    weights: bytes = b""


class Report(NamedTuple):
    """What an evaluator has played since its last report."""

    evaluator: str
    epoch: int
    steps: int
    games: tuple[Game, ...]
    done: bool
    """The task is ended."""


def encode_task(task: Task) -> bytes:
    return pack(task._asdict())


def decode_task(payload: bytes) -> Task:
    """The task inside ``payload``, its weights unchecked.

    Raises:
        MessageError: it is none.
    """
    message = unpack(payload)
    kind = take(message, "kind", str)
    if kind not in ("test", "wait", "finished"):
        raise MessageError(f"kind is {kind!r}")
    return Task(
        cast(Literal["test", "wait", "finished"], kind),
        take(message, "epoch", int, 0),
        take(message, "steps", int, 0),
        take(message, "epsilon", float, 0.0),
        take(message, "weights", bytes),
    )


def encode_report(report: Report) -> bytes:
    return pack(report._asdict())


def decode_report(payload: bytes) -> Report:
    """The report inside ``payload``.

    Raises:
        MessageError: it is none.
    """
    message: dict[str, Any] = unpack(payload)
    return Report(
        take(message, "evaluator", str),
        take(message, "epoch", int, 0),
        take(message, "steps", int, 0),
        take_games(message, MAX_GAMES),
        take(message, "done", bool),
    )
