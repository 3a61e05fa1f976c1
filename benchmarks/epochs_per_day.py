"""`python -m benchmarks.epochs_per_day`: how many of the report's epochs a day has room for.

An epoch is 250,000 steps of training and 125,000 of testing. Local mode runs three times, as it is:
until it trains in a steady state while its evaluator has nothing to do; so that the evaluator tests
all the time beside the training; and until training is over and the evaluator tests alone.

Of these come two figures. ``epochs_per_day`` sets training alone and test alone end to end, as in
2017. ``epochs_per_day_overlapped`` is what a run does: each epoch's test goes on beside the
training of the next, which it slows down.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

from benchmarks.local_run import LocalRun, Pace, Setting
from benchmarks.report import Report, Seconds, main
from common.run.presets import PRESETS
from learner.phases import epochs_per_day

_DAY = 86_400
_REPORT = PRESETS["paper"].protocol
_UNTIL_TEST = 10.0
"""Seconds of training before the second run's first test."""


@dataclass(frozen=True)
class Options(Setting):
    """Measure local mode's real processes at the report's ratio of updates to steps."""

    seconds: Seconds = 20.0
    """Seconds of each of the three windows; starting and settling take as long or longer."""


class Paces(NamedTuple):
    """The three windows of one setting."""

    training: Pace
    """The evaluator has nothing to do."""
    testing: Pace
    """The evaluator plays all the time, beside the training."""
    test_alone: float
    """Test steps per second while nobody trains."""

    @property
    def epochs_per_day(self) -> float | None:
        """Training and test one after the other."""
        rates = self.training.train_steps_per_second, self.test_alone
        return epochs_per_day(_REPORT.epoch_steps, _REPORT.test_steps, *rates)

    @property
    def epochs_per_day_overlapped(self) -> float | None:
        """Each test beside the next epoch's training."""
        if not self.testing.test_steps_per_second:
            return None
        testing = _REPORT.test_steps / self.testing.test_steps_per_second
        rest = max(_REPORT.epoch_steps - self.testing.train_steps_per_second * testing, 0.0)
        return _DAY / (testing + rest / self.training.train_steps_per_second)


def paces_of(setting: Setting, seconds: float) -> Paces:
    """The windows, in runs of their own."""
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
    """The figures for machines; those of training are of the first window.

    ``cpu_share`` is the second window's, in which all roles are at work.
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
        f"Local mode, {options}, actors: {options.actors}, batches of 32, an update per 4 steps "
        "(samples per insert; staleness in updates, p50; CPU of learner + actors + evaluator)",
        [row("idle", paces.training), row("testing", paces.testing)],
        summary(options, paces),
        *notes,
    )


if __name__ == "__main__":
    main("epochs_per_day", Options, measure)
