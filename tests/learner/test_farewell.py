"""The waits at a run's end, on the test's clock; `test_training.py` has what a run makes of it."""

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from common.protocol.chunk import Game
from common.protocol.evaluation import EvaluationReport
from common.settings.config import ProtocolConfig
from learner.evaluation.coordinator import EpochTest, EvaluationCoordinator
from learner.evaluation.snapshots import Snapshots
from learner.farewell import Farewell


class End(threading.Event):
    """A run's end: the stop event, whose waits turn the clock, and everything around it."""

    def __init__(self, pending: int = 0, **alive: bool) -> None:
        super().__init__()
        self.now = 0.0
        self.said: list[str] = []
        self.at: dict[float, Callable[[], None]] = {}
        """What happens at which second."""
        self.alive = alive
        self.look: Callable[[], None] = lambda: None
        evaluation: Any = SimpleNamespace(pending=pending, reports=0, finish=lambda: None)
        registry: Any = SimpleNamespace(alive=lambda role: self.alive.get(role, False))
        children: Any = SimpleNamespace(works=lambda role: False)
        self.evaluation, self.registry, self.children = evaluation, registry, children
        self.farewell = Farewell(
            *(evaluation, registry, children),
            look=lambda: self.look(),
            say=self.said.append,
            now=lambda: self.now,
            stop=self,
        )

    def wait(self, timeout: float | None = None) -> bool:
        self.now += timeout or 0.0
        for second in [second for second in self.at if second <= self.now]:
            self.at.pop(second)()
        return self.is_set()


@pytest.mark.parametrize("role", ["actor", "evaluator"])
def test_who_has_not_heard_of_the_end_is_waited_for_a_minute(role: str) -> None:
    end = End(**{role: True})
    end.farewell.wait_for_actors() if role == "actor" else end.farewell.wait_for_evaluators()
    assert end.now == pytest.approx(60, abs=1)
    assert end.said == []


def test_without_evaluators_and_without_a_test_there_is_nothing_to_say() -> None:
    end = End()
    end.farewell.wait_for_evaluators()
    assert (end.now, end.said) == (0, [])


def test_each_report_and_each_test_that_ends_grants_twenty_minutes_more() -> None:
    end = End(pending=2, evaluator=True)
    end.at = {
        1_000.0: lambda: setattr(end.evaluation, "pending", 1),
        2_000.0: lambda: setattr(end.evaluation, "reports", 1),
        3_000.0: lambda: setattr(end.evaluation, "pending", 0),
        3_010.0: end.alive.clear,
    }
    end.farewell.wait_for_evaluators()
    assert end.now == pytest.approx(3_010, abs=1)
    assert end.said == []


@pytest.mark.parametrize("stops", [True, False])
def test_neither_a_stop_nor_an_evaluator_that_leaves_is_silence(
    stops: bool,
) -> None:
    end = End(pending=1, evaluator=True)
    end.at = {100.0: end.set if stops else end.alive.clear}
    end.farewell.wait_for_evaluators()
    assert end.now < 102
    assert end.said == []


def test_twenty_minutes_without_a_report_are_the_end() -> None:
    end = End(pending=2, evaluator=True)
    end.at = {1_000.0: lambda: setattr(end.evaluation, "reports", 1), 19_999.0: end.set}
    end.farewell.wait_for_evaluators()
    assert end.now == pytest.approx(1_000 + 1_200 + 60, abs=2)
    assert [said[:37] for said in end.said] == ["No evaluator has reported for 20 minu"]


def test_who_plays_has_time_for_what_one_that_hangs_was_to_play(tmp_path: Path) -> None:
    end = End(evaluator=True)
    coordinator = EvaluationCoordinator(
        Snapshots(tmp_path),
        replace(ProtocolConfig(), test_steps=100),
        evaluators=lambda: {"hangs", "plays"},
        seconds=lambda: end.now,
        now=lambda: end.now,
    )
    coordinator.add(EpochTest(1, 1, 1, 1, None, remaining=100), b"w")
    assert coordinator.give_job("hangs").steps == 50

    def look() -> None:
        if (job := coordinator.give_job("plays")).kind == "test":
            game = (Game(1.0, 9),)
            coordinator.take_report(EvaluationReport("plays", 1, job.steps, game, done=True))
        if (test := coordinator.take_finished()) is not None:
            assert test.steps == 100
            end.alive.clear()

    end.look = look
    replace(end.farewell, evaluation=coordinator).wait_for_evaluators()
    assert end.now == pytest.approx(600, abs=10)
    assert end.said == []


def test_what_came_just_before_the_last_actor_left_is_taken_in() -> None:
    end = End()
    came: list[str] = []
    taken: list[str] = []
    end.look = lambda: taken.extend(came)
    end.registry.alive = lambda role: came.append("its last chunk")
    end.farewell.wait_for_actors()
    assert taken == ["its last chunk"]


def test_a_local_evaluator_that_has_just_ended_is_started_again_and_expected() -> None:
    end = End(pending=1)
    end.look = lambda: setattr(end.children, "works", lambda role: role == "evaluator")
    end.at = {5.0: lambda: setattr(end.evaluation, "pending", 0)}
    end.farewell.wait_for_evaluators()
    assert end.now == pytest.approx(5, abs=1)
    assert end.said == []
