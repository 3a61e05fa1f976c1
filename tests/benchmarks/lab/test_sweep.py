"""Sweeps: what is varied, and a study with real trainings where Optuna is installed."""

from pathlib import Path

import pytest

from benchmarks.lab.sweep import Axis, Options, measure
from common.errors import InputError
from tests.end_to_end.conftest import SMALL


@pytest.mark.parametrize(
    ("text", "axis"),
    [
        ("learning.n-step=3,5,10", Axis("learning.n-step", ("3", "5", "10"))),
        ("--learning.n-step=3:10", Axis("learning.n-step", low=3, high=10, whole=True)),
        ("learning.discount=0.9:0.99", Axis("learning.discount", low=0.9, high=0.99)),
        (
            "learning.learning-rate=1e-5:1e-3:log",
            Axis("learning.learning-rate", low=1e-5, high=1e-3, log=True),
        ),
    ],
)
def test_what_is_varied(text: str, axis: Axis) -> None:
    assert Axis.parse(text) == axis


@pytest.mark.parametrize(
    "text", ["", "x", "x=", "=1,2", "x=1:", "x=2:1", "x=1:2:lin", "x=0:1:log", "x=1:nan", "x=a:b"]
)
def test_what_cannot_be_varied_is_told_with_an_example(text: str) -> None:
    with pytest.raises(InputError, match=r"write it as learning\.n-step=3,5,10"):
        Axis.parse(text)


@pytest.mark.slow
@pytest.mark.filterwarnings("error::FutureWarning")  # by which Optuna tells what it will remove
def test_a_study_trains_tells_its_scores_and_goes_on(tmp_path: Path) -> None:
    pytest.importorskip("optuna", reason="Optuna is not installed: pip install 'ale-robot[sweep]'")
    options = Options(
        study="small",
        vary=("learning.learning-rate=5e-5:1e-3:log", "learning.n-step=3,5"),
        trials=1,
        steps=2_500,
        learner=" ".join(["--env", "ale", *SMALL, "--play.max-game-frames", "400"]),
        runs=tmp_path / "runs",
    )
    first = measure(options).content
    again = measure(options).content
    assert [len(each["rows"]) for each in (first, again)] == [1, 2]
    for row in again["rows"]:
        assert row["state"] == "complete"
        assert row["epochs"] >= 3
        assert -21 <= row["score"] <= 0
        assert 1e-5 <= row["--learning.learning-rate"] <= 1e-3
    assert again["best"].startswith("python -m learner --local --env ale")
    with pytest.raises(InputError, match="training of trial 2 ended, and said: "):
        measure(Options(study="small", vary=("no.such=1,2",), trials=1, runs=tmp_path / "runs"))
