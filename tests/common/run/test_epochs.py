"""The table of epochs, against rows written by hand and a line of the 2017 results."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import InputError
from common.run.epochs import EpochRow, EpochTable, epochs_per_day

HEADER = (
    "epoch,phase,steps,nr_games,average_reward,min_game_reward,max_game_reward,"
    "last_exploration_rate,total_train_steps,replay_memory_count,meanq,meancost,"
    "weight_updates,total_time,epoch_time,steps_per_second\n"
)
TRAIN = EpochRow(
    epoch=1,
    phase="train",
    steps=250_000,
    nr_games=266,
    average_reward=-20.067669172932305,
    min_game_reward=-21.0,
    max_game_reward=-16.0,
    last_exploration_rate=0.775,
    total_train_steps=250_000,
    replay_memory_count=300_000,
    meanq=-1.82126,
    meancost=0.197364886434,
    weight_updates=62_500,
    total_time=1389.785272,
    epoch_time=1341.796652,
    steps_per_second=186.31735265352265,
)
TRAIN_LINE = (
    "1,train,250000,266,-20.067669172932305,-21,-16,0.775,250000,300000,"
    "-1.82126,0.197364886434,62500,1389.785272,1341.796652,186.31735265352265\n"
)


QUOTED = HEADER + TRAIN_LINE.replace("train", '"train') + TRAIN_LINE
"""A cell that a reader of all lines would end in the next."""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "epochs.csv"


def filled(path: Path, count: int) -> list[EpochRow]:
    rows = [replace(TRAIN, epoch=epoch) for epoch in range(1, count + 1)]
    for row in rows:
        EpochTable(path).append(row)
    return rows


def test_file_is_that_of_2017(path: Path) -> None:
    EpochTable(path).append(TRAIN)
    assert path.read_text() == HEADER + TRAIN_LINE


def test_phase_without_a_game_has_empty_reward_cells(path: Path) -> None:
    row = EpochRow.of_games(
        [],
        epoch=0,
        phase="random",
        steps=100,
        last_exploration_rate=1.0,
        total_train_steps=0,
        replay_memory_count=100,
        meanq=None,
        meancost=None,
        weight_updates=0,
        total_time=8.0,
        epoch_time=8.0,
    )
    table = EpochTable(path)
    table.append(row)
    assert path.read_text() == HEADER + "0,random,100,0,,,,1,0,100,,,0,8,8,12.5\n"
    assert table.rows() == [row]


def test_row_of_games_by_hand() -> None:
    row = EpochRow.of_games(
        [-21.0, -18.0, -20.0],
        epoch=3,
        phase="test",
        steps=3_000,
        last_exploration_rate=0.05,
        total_train_steps=75_000,
        replay_memory_count=85_000,
        meanq=0.5,
        meancost=0.0,
        weight_updates=18_750,
        total_time=900.0,
        epoch_time=60.0,
    )
    assert (row.nr_games, row.min_game_reward, row.max_game_reward) == (3, -21.0, -18.0)
    assert row.average_reward == pytest.approx(-59 / 3)
    assert row.steps_per_second == 50.0


finite = st.floats(allow_nan=False)


@given(
    row=st.builds(
        EpochRow,
        epoch=st.integers(0, 10**6),
        phase=st.sampled_from(["random", "train", "test"]),
        steps=st.integers(0, 10**12),
        nr_games=st.integers(0, 10**6),
        average_reward=st.none() | finite,
        min_game_reward=st.none() | finite,
        max_game_reward=st.none() | finite,
        last_exploration_rate=finite,
        total_train_steps=st.integers(0, 10**12),
        replay_memory_count=st.integers(0, 10**7),
        meanq=st.none() | finite,
        meancost=st.none() | finite,
        weight_updates=st.integers(0, 10**12),
        total_time=finite,
        epoch_time=finite,
        steps_per_second=finite,
    )
)
def test_round_trip(tmp_path_factory: pytest.TempPathFactory, row: EpochRow) -> None:
    table = EpochTable(tmp_path_factory.mktemp("table") / "epochs.csv")
    table.append(row)
    table.append(row)
    assert table.rows() == [row, row]


def test_diverged_learner_can_still_be_read(path: Path) -> None:
    table = EpochTable(path)
    table.append(replace(TRAIN, meanq=math.nan))
    (row,) = table.rows()
    assert row.meanq is not None
    assert math.isnan(row.meanq)


def test_no_file_is_no_rows(path: Path) -> None:
    assert EpochTable(path).rows() == []
    assert EpochTable(path).keep(0) == []


def test_resume_drops_what_the_checkpoint_does_not_know(path: Path) -> None:
    rows = filled(path, 3)
    table = EpochTable(path)
    assert table.keep(2) == rows[:2]
    assert table.rows() == rows[:2]
    table.append(rows[2])
    assert table.rows() == rows
    assert [entry.name for entry in path.parent.iterdir()] == ["epochs.csv"]


def test_resume_mends_a_torn_last_row(path: Path) -> None:
    rows = filled(path, 3)
    whole = path.read_bytes()
    path.write_bytes(whole[:-1])  # a number that lost its end would still look like one
    with pytest.raises(InputError, match="row 3 is not whole"):
        EpochTable(path).rows()
    assert EpochTable(path).keep(2) == rows[:2]
    assert EpochTable(path).rows() == rows[:2]


def test_resume_with_rows_missing_is_refused(path: Path) -> None:
    filled(path, 2)
    with pytest.raises(InputError, match="has 2 rows where the checkpoint knows of 3"):
        EpochTable(path).keep(3)
    assert len(EpochTable(path).rows()) == 2


def test_an_evaluation_is_told_its_figure(tmp_path: Path) -> None:
    file = tmp_path / "evaluation.json"
    file.write_text("{}\n")
    with pytest.raises(InputError, match="add --figure histogram if it is an evaluation"):
        EpochTable(file).rows()


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"", "does not name the columns"),
        (b"epoch,phase\n", "does not name the columns"),
        (HEADER.rstrip().encode(), "does not name the columns"),
        (QUOTED.encode(), "row 1 is not whole"),
        ((HEADER + "1" * 200_000).encode(), "row 1: field larger than field limit"),
        (b"\xff\xfe\x00", "it is not text"),
        ((HEADER + "1,train\n").encode(), "row 1 is not whole"),
        (
            (HEADER + TRAIN_LINE.replace("train", "dream")).encode(),
            "row 1.phase is 'dream': choose",
        ),
        (
            (HEADER + TRAIN_LINE.replace("266", "-1")).encode(),
            "row 1.nr_games is -1: choose 0 or more",
        ),
        (
            (HEADER + TRAIN_LINE.replace("0.775", "")).encode(),
            "row 1.last_exploration_rate is None, which is not",
        ),
        (
            (HEADER + TRAIN_LINE + TRAIN_LINE.replace("-16", "x")).encode(),
            "row 2.max_game_reward is 'x', which is not",
        ),
    ],
)
def test_damage_is_one_sentence(path: Path, content: bytes, what: str) -> None:
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"epochs\.csv is (damaged|not a table of)") as caught:
        EpochTable(path).rows()
    assert what in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ((250_000, 125_000, 126.0, 352.0), 36.94),  # the rates of ALE-Only in 2017
        ((250_000, 0, 250.0, None), 86.4),
        ((250_000, 125_000, 250.0, None), None),
        ((250_000, 125_000, 0.0, 500.0), None),
        ((250_000, 125_000, None, 500.0), None),
    ],
)
def test_epochs_per_day(arguments: Any, expected: float | None) -> None:
    assert epochs_per_day(*arguments) == pytest.approx(expected, abs=0.005)
