"""Tasks and reports between learner and evaluators."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import MessageError
from common.protocol.chunk import Game
from common.protocol.evaluation import (
    MAX_GAMES,
    EvaluationJob,
    EvaluationReport,
    decode_job,
    decode_report,
    encode_job,
    encode_report,
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
def test_a_task_survives_the_wire(task: EvaluationJob) -> None:
    assert decode_job(encode_job(task)) == task


@given(
    st.builds(
        EvaluationReport,
        st.text(max_size=64),
        COUNTS,
        COUNTS,
        st.lists(GAMES, max_size=5).map(tuple),
        st.booleans(),
    )
)
def test_a_report_survives_the_wire(report: EvaluationReport) -> None:
    assert decode_report(encode_report(report)) == report


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("kind", "sleep"),
        ("kind", None),
        ("epoch", -1),
        ("steps", 1.5),
        ("epsilon", -0.1),
        ("epsilon", float("nan")),
        ("epsilon", 0),
        ("weights", "text"),
        ("weights", None),
    ],
)
def test_a_wrong_task_is_refused(name: str, value: Any) -> None:
    with pytest.raises(MessageError, match=name):
        decode_job(pack(TASK._asdict() | {name: value}))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("evaluator", 1),
        ("evaluator", "x" * 201),
        ("epoch", None),
        ("steps", -1),
        ("games", None),
        ("games", "text"),
        ("done", 1),
    ],
)
def test_a_wrong_report_is_refused(name: str, value: Any) -> None:
    with pytest.raises(MessageError, match=name):
        decode_report(pack(REPORT._asdict() | {name: value}))


@pytest.mark.parametrize("game", [None, [1.0], [1, 2], [1.0, -1], [float("nan"), 1]])
def test_a_wrong_game_is_refused(game: Any) -> None:
    with pytest.raises(MessageError, match="score and steps"):
        decode_report(pack(REPORT._asdict() | {"games": [game]}))


def test_games_are_bounded() -> None:
    most = REPORT._replace(games=(Game(1.0, 1),) * MAX_GAMES)
    assert decode_report(encode_report(most)) == most
    with pytest.raises(MessageError, match="games at most"):
        decode_report(encode_report(most._replace(games=most.games + most.games[:1])))


@given(st.binary(max_size=50))
def test_anything_else_is_refused(payload: bytes) -> None:
    with pytest.raises(MessageError):
        decode_job(payload)
    with pytest.raises(MessageError):
        decode_report(payload)
