"""The waits at the end of a run: for its actors, its last tests and its evaluators."""

import threading
from collections.abc import Callable
from dataclasses import dataclass

from common.process.supervisor import Supervisor
from common.schedule import Now
from learner.evaluation.coordinator import MAX_SILENCE, EvaluationCoordinator
from learner.telemetry.actor_registry import ActorRegistry

LOOK_SECONDS = 0.25
"""Seconds between two looks at other processes."""
_TO_LEAVE = 60.0
"""Seconds that the actors, and then the evaluators, of a finished run have to leave. A process that
has not heard of the end by then waits for a learner that never comes back."""
_LAST_TESTS = 2 * MAX_SILENCE
"""Seconds without a report from any evaluator after which the last tests are given up: enough to
take the test from one that hangs, so that another plays it."""


@dataclass(frozen=True)
class Farewell:
    """Waits for the processes of a run whose steps have all been played, or until ``stop``."""

    evaluation: EvaluationCoordinator
    registry: ActorRegistry
    children: Supervisor | None
    """Local mode's actors and evaluators."""
    look: Callable[[], None]
    """Takes in what happened in other processes."""
    say: Callable[[str], None]
    now: Now
    stop: threading.Event

    def wait_for_actors(self) -> None:
        """Lets the actors hand in their last chunks and leave."""
        self._look_while(lambda: self.registry.alive("actor"), _TO_LEAVE)

    def wait_for_evaluators(self) -> None:
        """Lets the evaluators play the last tests and leave; says so if epochs stay untested."""
        self.evaluation.finish()
        self.look()  # a local evaluator that has just ended is started again
        if self.evaluation.pending and not self._evaluator_expected() and self.children is None:
            # Local mode without evaluators was asked for.
            self.say(
                "There is no evaluator, so epochs stay untested: start one before the learner next "
                f"time, by `{self.evaluation.join} --evaluator --patience inf`."
            )
        self._look_while(
            lambda: self.evaluation.pending and self._evaluator_expected(),
            _LAST_TESTS,
            progress=lambda: (self.evaluation.pending, self.evaluation.reports),
        )
        if self.evaluation.pending and self._evaluator_expected() and not self.stop.is_set():
            self.say(
                f"No evaluator has reported for {_LAST_TESTS / 60:g} minutes, so epochs stay "
                "untested: check whether they play, and whether snapshots/ can be read."
            )
        self._look_while(lambda: self.registry.alive("evaluator"), _TO_LEAVE)

    def _evaluator_expected(self) -> bool:
        """Returns whether an evaluator is present, or is a local child that has not joined yet."""
        starting = self.children is not None and self.children.works("evaluator")
        return starting or bool(self.registry.alive("evaluator"))

    def _look_while(
        self,
        busy: Callable[[], object],
        patience: float,
        progress: Callable[[], object] = lambda: None,
    ) -> None:
        """Waits while ``busy`` returns something true, at most ``patience`` seconds without a
        change of ``progress``."""
        before, ends = progress(), self.now() + patience
        while busy() and self.now() < ends and not self.stop.wait(LOOK_SECONDS):
            self.look()
            if (now := progress()) != before:
                before, ends = now, self.now() + patience
        self.look()
