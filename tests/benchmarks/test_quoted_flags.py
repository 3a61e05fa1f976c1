"""Flags that a flag holds as quoted text."""

from pathlib import Path

import pytest

from benchmarks.lab import demonstrations, ladder, race
from benchmarks.lab.policy import TrainingOptions
from benchmarks.quoted_flags import quoted_flags
from common.errors import InputError


def test_words_are_those_of_a_shell() -> None:
    text = """--robot 'a b.npz' --learning.n-step=3"""
    assert quoted_flags(text, "--learner") == ["--robot", "a b.npz", "--learning.n-step=3"]
    assert quoted_flags("", "--learner") == []


def test_an_open_quote_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"--to is '--robot \"a' \(No closing quotation\): quote it"
    ):
        quoted_flags('--robot "a', "--to")


@pytest.mark.parametrize("text", ["--threads 1 --seed 9", "--seed=9"])
def test_a_flag_that_the_experiment_gives_is_refused(text: str) -> None:
    assert quoted_flags(text, "--learner", ["--steps"])
    with pytest.raises(InputError, match="names --seed, which the experiment itself gives: omit"):
        quoted_flags(text, "--learner", ["--steps", "--seed"])


@pytest.mark.parametrize(
    ("options", "own"),
    [
        (race.Options(learner="--threads 1 --seed 9"), "--seed"),
        (race.Options(learner="--env=ale"), "--env"),
        (ladder.Options(rung="R1", learner="--steps 9"), "--steps"),
        (demonstrations.Options(recording=Path("d"), learner="--run r"), "--run"),
    ],
)
def test_a_run_is_trained_as_its_row_tells(options: TrainingOptions, own: str) -> None:
    with pytest.raises(InputError, match=f"--learner names {own}, which the experiment itself"):
        options.check()
