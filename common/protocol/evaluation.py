"""Evaluation jobs, from learner to evaluators, and their reports: which weights, which scores."""

from typing import Any, Literal, NamedTuple, cast

from common.errors import MessageError
from common.protocol.chunk import Game, take_games
from common.protocol.wire import pack, take, unpack

MAX_GAMES = 10_000


class EvaluationJob(NamedTuple):
    """The learner's answer to an evaluator that asks for work."""

    kind: Literal["test", "wait", "finished"]
    epoch: int = 0
    steps: int = 0
    """Decisions to play, then to the end of the first game if none has ended."""
    epsilon: float = 0.0
    weights: bytes = b""


class EvaluationReport(NamedTuple):
    """What an evaluator has played since its last report."""

    evaluator: str
    epoch: int
    steps: int
    games: tuple[Game, ...]
    done: bool
    """The job is done."""


def encode_job(job: EvaluationJob) -> bytes:
    return pack(job._asdict())


def decode_job(payload: bytes) -> EvaluationJob:
    """Returns the job inside ``payload``, its weights unchecked.

    Raises:
        MessageError: the payload is malformed.
    """
    message = unpack(payload)
    kind = take(message, "kind", str)
    if kind not in ("test", "wait", "finished"):
        raise MessageError(f"kind is {kind!r}")
    return EvaluationJob(
        cast(Literal["test", "wait", "finished"], kind),
        take(message, "epoch", int, 0),
        take(message, "steps", int, 0),
        take(message, "epsilon", float, 0.0),
        take(message, "weights", bytes),
    )


def encode_report(report: EvaluationReport) -> bytes:
    return pack(report._asdict())


def decode_report(payload: bytes) -> EvaluationReport:
    """Returns the report inside ``payload``.

    Raises:
        MessageError: the payload is malformed.
    """
    message: dict[str, Any] = unpack(payload)
    return EvaluationReport(
        take(message, "evaluator", str),
        take(message, "epoch", int, 0),
        take(message, "steps", int, 0),
        take_games(message, MAX_GAMES),
        take(message, "done", bool),
    )
