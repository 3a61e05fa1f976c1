"""Tasks and reports between learner and evaluators."""

import dataclasses
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.checked import NAME
from common.errors import MessageError
from common.protocol.chunk import Game
from common.protocol.evaluation import (
    MAX_GAMES,
    EvaluationJob,
    EvaluationReport,
)
from common.protocol.wire import pack

COUNTS = st.integers(0, 2**63 - 1)
GAMES = st.builds(Game, st.floats(-1e6, 1e6), st.integers(0, 2**31 - 1))
TASK = EvaluationJob("test", 3, 125_000, 0.05, b"weights")
REPORT = EvaluationReport("evaluator", 3, 640, (Game(-21.0, 764),), False)


@given(
    st.builds(
        EvaluationJob,
        st.sampled_from(["test", "wait", "finished"]),
        COUNTS,
        COUNTS,
        st.floats(0, 1),
        st.binary(max_size=100),
    )
)
def test_a_job_survives_the_wire(job: EvaluationJob) -> None:
    assert EvaluationJob.decode(job.encode()) == job


@given(
    st.builds(
        EvaluationReport,
        st.from_regex(NAME, fullmatch=True),
        COUNTS,
        st.integers(5, 2**31 - 1),
        st.lists(GAMES, max_size=5).map(tuple),
        st.booleans(),
    )
)
def test_a_report_survives_the_wire(report: EvaluationReport) -> None:
    assert EvaluationReport.decode(report.encode()) == report


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("kind", "sleep"),
        ("kind", None),
        ("epoch", -1),
        ("steps", 1.5),
        ("epsilon", -0.1),
        ("epsilon", float("nan")),
        ("epsilon", "0"),
        ("weights", "text"),
        ("weights", None),
    ],
)
def test_a_wrong_job_is_refused(name: str, value: Any) -> None:
    with pytest.raises(MessageError, match=name):
        EvaluationJob.decode(pack(dataclasses.asdict(TASK) | {name: value}))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("evaluator", 1),
        ("evaluator", "x" * 201),
        ("epoch", None),
        ("steps", -1),
        ("steps", 2**31),
        ("games", None),
        ("games", "text"),
        ("done", 1),
    ],
)
def test_a_wrong_report_is_refused(name: str, value: Any) -> None:
    with pytest.raises(MessageError, match=name):
        EvaluationReport.decode(pack(dataclasses.asdict(REPORT) | {name: value}))


@pytest.mark.parametrize(
    "game", [None, [1.0], ["1", 2], [1.0, -1], [float("nan"), 1], [1e308, 1], [-1e308, 1]]
)
def test_a_wrong_game_is_refused(game: Any) -> None:
    with pytest.raises(MessageError, match="games"):
        EvaluationReport.decode(pack(dataclasses.asdict(REPORT) | {"games": [game]}))


def test_games_are_bounded() -> None:
    most = dataclasses.replace(REPORT, steps=MAX_GAMES, games=(Game(1.0, 1),) * MAX_GAMES)
    assert EvaluationReport.decode(most.encode()) == most
    with pytest.raises(MessageError, match=r"games is .* choose at most"):
        EvaluationReport.decode(
            dataclasses.replace(most, games=most.games + most.games[:1]).encode()
        )


def test_a_game_has_a_step_of_its_own() -> None:
    most = dataclasses.replace(REPORT, steps=2, games=(Game(1.0, 1),) * 2)
    assert EvaluationReport.decode(most.encode()) == most
    with pytest.raises(MessageError, match="2 games in 1 steps"):
        EvaluationReport.decode(dataclasses.replace(most, steps=1).encode())


@given(st.binary(max_size=50))
def test_anything_else_is_refused(payload: bytes) -> None:
    with pytest.raises(MessageError):
        EvaluationJob.decode(payload)
    with pytest.raises(MessageError):
        EvaluationReport.decode(payload)
