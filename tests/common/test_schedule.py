"""What is due when."""

from common.schedule import Every


class Now:
    def __init__(self) -> None:
        self.seconds = 50.0

    def __call__(self) -> float:
        return self.seconds


def test_a_schedule_is_due_at_once_and_then_after_each_period() -> None:
    now = Now()
    schedule = Every(10.0, now)
    due = []
    for _ in range(30):
        due.append(schedule.is_due())
        now.seconds += 1.0
    assert [second for second, is_due in enumerate(due) if is_due] == [0, 10, 20]


def test_what_was_done_anyway_is_due_a_period_later() -> None:
    now = Now()
    schedule = Every(10.0, now)
    schedule.restart()
    now.seconds += 9.0
    assert not schedule.is_due()
    schedule.restart()
    now.seconds += 9.0
    assert not schedule.is_due()
    now.seconds += 1.0
    assert schedule.is_due()
