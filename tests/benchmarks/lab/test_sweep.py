"""Sweeps: what is varied, and a study with real trainings where Optuna is installed."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

import pytest

from benchmarks.lab import sweep
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


def options_of(runs: Path, **given: Any) -> Options:
    about: dict[str, Any] = {
        "study": "small",
        "vary": ("learning.learning-rate=5e-5:1e-3:log", "learning.n-step=3,5"),
        "trials": 1,
        "steps": 2_500,
        "learner": " ".join(["--env", "ale", *SMALL, "--play.max-game-frames", "400"]),
        "runs": runs,
    }
    return Options(**{**about, **given})


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"vary": ("learning.n-stp=3,5",)}, r"--learning\.n-stp"),
        ({"vary": ("learning.n-step=3,x",)}, r"--learning\.n-step"),
        ({"vary": ("learning.discount=0.9:1.5",)}, r"learning\.discount is 1\.5: choose"),
        ({"vary": ("learning.n-step=0:3",)}, r"learning\.n-step is 0: choose 1 or more"),
        ({"learner": "--env nowhere"}, "nowhere"),
        ({"steps": 300}, r"--steps is 300, .*: choose more, or lower --"),
        ({"steps": 60_000, "learner": "--env robot"}, None),
        ({"steps": 59_999, "learner": "--env robot"}, "the first epoch ends after 60000: choose m"),
    ],
)
def test_what_no_trial_could_train_with_is_told_before_the_study(
    given: dict[str, Any], words: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Asked(Exception):
        """The next thing that the program wants is Optuna."""

    def optuna_needed(*_: str) -> NoReturn:
        raise Asked

    monkeypatch.setattr(sweep, "extra_for", optuna_needed)
    runs = tmp_path / "runs"
    with pytest.raises(InputError if words else Asked, match=words):
        measure(options_of(runs, **given))
    assert not runs.exists()


@pytest.fixture
def optuna() -> Any:
    return pytest.importorskip(
        "optuna", reason="Optuna is not installed: pip install 'ale-robot[sweep]'"
    )


class Trained:
    """A training that has ended with one epoch, of which the score is 1."""

    returncode = 0

    def __init__(self, *_: Any, **__: Any) -> None:
        pass

    def poll(self) -> int:
        return 0

    def end(self) -> None:
        pass


@pytest.fixture
def quick(optuna: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweep, "Child", Trained)
    monkeypatch.setattr(sweep, "scores_of", lambda _: [(SimpleNamespace(epoch=1), 1.0)])


@pytest.mark.usefixtures("quick")
def test_each_trial_draws_other_settings_whoever_plays_it(tmp_path: Path) -> None:
    """Three starts of one trial, as of three workers, draw what one start of three draws."""
    drawn = []
    for runs, trials in ((tmp_path / "a", (1, 1, 1)), (tmp_path / "b", (3,))):
        for number in trials:
            rows = measure(options_of(runs, trials=number)).content["rows"]
        drawn.append(sorted(row["--learning.learning-rate"] for row in rows))
    assert drawn[0] == drawn[1]
    assert len(set(drawn[0])) == 3


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(
    "other",
    [
        {"steps": 3_000},
        {"seed": 2},
        {"learner": "--env ale --replay.learning-starts 300 --protocol.epoch-steps 500"},
        {"vary": ("learning.n-step=3,5,7",)},
    ],
    ids=lambda other: next(iter(other)),
)
def test_a_study_goes_on_with_its_own_flags_alone(other: dict[str, Any], tmp_path: Path) -> None:
    measure(options_of(tmp_path))
    (name,) = other
    with pytest.raises(InputError, match=f"small was begun with --{name} .* or name another stud"):
        measure(options_of(tmp_path, **other))
    assert len(measure(options_of(tmp_path)).content["rows"]) == 2


@pytest.mark.slow
@pytest.mark.usefixtures("optuna")
@pytest.mark.filterwarnings("error::FutureWarning")  # by which Optuna tells what it will remove
def test_a_study_trains_tells_its_scores_and_goes_on(tmp_path: Path) -> None:
    options = options_of(tmp_path / "runs")
    first = measure(options).content
    again = measure(options).content
    assert [len(each["rows"]) for each in (first, again)] == [1, 2]
    for row in again["rows"]:
        assert row["state"] == "complete"
        assert row["epochs"] >= 3
        assert -21 <= row["score"] <= 0
        assert 1e-5 <= row["--learning.learning-rate"] <= 1e-3
    assert again["best"].startswith("python -m learner --local --env ale")
