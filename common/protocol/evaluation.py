"""Evaluation jobs, from learner to evaluators, and the evaluators' reports."""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Lt, MaxLen

from common.checked import Count, Fraction, Name, Rows
from common.errors import MessageError
from common.protocol.chunk import Game
from common.protocol.message import Message
from common.protocol.wire import MAX_ITEMS

MAX_GAMES = MAX_ITEMS - 1


@dataclass(frozen=True)
class EvaluationJob(Message):
    """The learner's answer to an evaluator that asks for work."""

    kind: Literal["test", "wait", "finished"]
    epoch: Count = 0
    steps: Count = 0
    """Agent steps to play; if no game has ended by then, the evaluator plays the first to its
    end."""
    epsilon: Fraction = 0.0
    weights: bytes = b""
    """The weights, not checked yet."""
    run_id: str = ""
    """Identity of the learner's run."""
    signature: bytes = b""
    """The learner's signature of weights, epoch and run, not checked yet."""


@dataclass(frozen=True)
class EvaluationReport(Message):
    """What an evaluator has played since its last report; neither steps nor games if it only says
    that a game goes on."""

    evaluator: Name
    epoch: Count
    steps: Annotated[int, Ge(0), Lt(2**31)]
    games: Annotated[Rows[Game], MaxLen(MAX_GAMES)]
    done: bool
    """Whether the job is done."""
    run_id: str = ""
    """Identity of the job's run."""

    def check(self) -> None:
        """See `Message.check`: refuses more games than could end."""
        if len(self.games) > self.steps:
            raise MessageError(f"{len(self.games)} games in {self.steps} steps")
