"""`python -m benchmarks.epochs_per_day`: how many epochs of 2017 a day has room for.

An epoch is 250,000 steps of training and 125,000 of testing. Unchanged local mode runs three times:

1. it trains in a steady state while its evaluator is idle;
2. the evaluator tests all the time beside the training;
3. training is over, and the evaluator tests alone.

They give two figures. ``epochs_per_day`` puts training alone and testing alone end to end, as in
2017. ``epochs_per_day_overlapped`` is what a run does: each epoch is tested during the training of
the next, which that slows down.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

from benchmarks.local_run import LocalRun, Pace, Setting
from benchmarks.report import Report, Seconds, main
from common.run.epochs import epochs_per_day
from common.settings.presets import PRESETS

_DAY = 86_400
_REPORT = PRESETS["paper"].protocol
_UNTIL_TEST = 10.0
"""Seconds of training before the first test of the second run."""


@dataclass(frozen=True)
class Options(Setting):
    """Measure local mode's real processes at the 2017 ratio of samples to steps."""

    seconds: Seconds = 20.0
    """Length of each of the three windows, in seconds; starting and settling take as long or
    longer."""


class Paces(NamedTuple):
    """The rates in the three windows of one setting."""

    training: Pace
    """Rates while the evaluator is idle."""
    testing: Pace
    """Rates while the evaluator plays all the time beside the training."""
    test_alone: float
    """Test steps per second without training."""

    @property
    def epochs_per_day(self) -> float | None:
        """Epochs per day if training and test take turns."""
        rates = self.training.train_steps_per_second, self.test_alone
        return epochs_per_day(_REPORT.epoch_steps, _REPORT.test_steps, *rates)

    @property
    def epochs_per_day_overlapped(self) -> float | None:
        """Epochs per day if each test runs beside the next epoch's training."""
        if not self.testing.test_steps_per_second:
            return None
        testing = _REPORT.test_steps / self.testing.test_steps_per_second
        rest = max(_REPORT.epoch_steps - self.testing.train_steps_per_second * testing, 0.0)
        return _DAY / (testing + rest / self.training.train_steps_per_second)


def paces_of(setting: Setting, seconds: float) -> Paces:
    """Returns the rates in the three windows, each measured in a run of its own."""
    with LocalRun(setting) as run:
        run.settle()
        training = run.measure(seconds)
    epoch = max(int(training.train_steps_per_second * _UNTIL_TEST), 1)
    with LocalRun(setting, epoch_steps=epoch) as run:
        run.settle()
        run.await_tests()
        run.settle()
        testing = run.measure(seconds)
    with LocalRun(setting, epoch_steps=epoch, steps=2 * epoch) as run:
        run.await_tests()
        run.await_rest()
        alone = run.test_rate(seconds)
    return Paces(training, testing, alone)


def row(name: str, pace: Pace) -> dict[str, Any]:
    return {
        "evaluator": name,
        "train/s": pace.train_steps_per_second,
        "test/s": pace.test_steps_per_second,
        "updates/s": pace.updates_per_second,
        "samples": pace.samples_per_insert,
        "stale": pace.staleness_p50,
        **({} if pace.deadlines_kept is None else {"in time": pace.deadlines_kept}),
        "CPU": " + ".join(f"{share:.0%}" for share in pace.cpu_share.values()),
    }


def summary(setting: Setting, paces: Paces) -> dict[str, Any]:
    """Returns the figures for the JSON file.

    Those of training come from the first window. ``cpu_share`` comes from the second one, in which
    all roles work.
    """
    training, testing, _ = paces
    return {
        "epochs_per_day": paces.epochs_per_day,
        "epochs_per_day_overlapped": paces.epochs_per_day_overlapped,
        "train_steps_per_second": training.train_steps_per_second,
        "train_steps_per_second_beside_test": testing.train_steps_per_second,
        "test_steps_per_second": paces.test_alone,
        "test_steps_per_second_beside_training": testing.test_steps_per_second,
        "updates_per_second": training.updates_per_second,
        "samples_per_insert": training.samples_per_insert,
        "staleness_updates": {"p50": training.staleness_p50, "p95": training.staleness_p95},
        "deadlines_kept": training.deadlines_kept,
        "cpu_share": testing.cpu_share,
        "cpu_share_training": training.cpu_share,
        "env": setting.env,
        "game": setting.game,
        "sync": setting.clock.sync,
        "wait_action": setting.clock.wait_action,
        "actors": setting.actors,
        "evaluators": setting.evaluators,
        "learner_flags": setting.learner,
        "windows": {"training": training._asdict(), "testing": testing._asdict()},
    }


def measure(options: Options) -> Report:
    paces = paces_of(options, options.seconds)
    notes = []
    if paces.epochs_per_day is not None and paces.epochs_per_day_overlapped is not None:
        notes.append(
            f"{paces.epochs_per_day:.1f} epochs a day, training and tests one after the other (the "
            f"tests at {paces.test_alone:,.0f} steps/s); "
            f"{paces.epochs_per_day_overlapped:.1f} as local mode does it, side by side."
        )
    return Report.of(
        f"Local mode, {options}, actors: {options.actors} "
        "(samples per insert; staleness in updates, p50; CPU of learner + actors + evaluator)",
        [row("idle", paces.training), row("testing", paces.testing)],
        summary(options, paces),
        *notes,
    )


if __name__ == "__main__":
    main("epochs_per_day", Options, measure)
