"""What is done again and again ends as it is told, and a process with any of its threads."""

import sys
import threading
from itertools import count

import pytest

from common.errors import InputError
from common.exit_codes import FAILED
from common.process.threads import end_with_any_thread, repeat
from tests.patience import PATIENCE


def test_what_is_repeated_is_told_of_its_end_and_over_then() -> None:
    number, again, over = count(1), threading.Event(), list[bool]()

    def work(ended: threading.Event) -> None:
        if next(number) == 2:
            again.set()
            over.append(ended.wait(PATIENCE))

    end = repeat("again", 0.0, work)
    assert again.wait(PATIENCE)
    end()
    assert over == [True]


def _die() -> None:
    raise ValueError("a version of twenty nines")


def _live_with(failure: BaseException | None = None) -> None:
    """The process' work beside a thread that dies."""
    stop = threading.Event()
    with end_with_any_thread(stop):
        threading.Thread(target=_die, name="answers").start()
        assert stop.wait(PATIENCE)
        if failure is not None:
            raise failure


@pytest.fixture(autouse=True)
def _quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threading, "excepthook", lambda _: None)


@pytest.mark.parametrize("failure", [None, InputError("it was stopped"), KeyboardInterrupt()])
def test_the_first_thread_that_dies_stops_the_process_with_its_reason(
    failure: BaseException | None,
) -> None:
    """Whatever the process says of being stopped: its exit code tells to start it again."""
    reason = r"'answers' died \(ValueError: a version of twenty nines\)"
    with pytest.raises(InputError, match=reason) as ended:
        _live_with(failure)
    assert ended.value.exit_code == FAILED


def test_a_death_of_which_nobody_can_read_stops_the_process_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def print_nowhere(_: threading.ExceptHookArgs) -> None:
        raise BrokenPipeError

    monkeypatch.setattr(threading, "excepthook", print_nowhere)
    with pytest.raises(InputError, match="'answers' died"):
        _live_with()


def test_a_thread_that_ends_stops_nothing() -> None:
    stop = threading.Event()
    before = threading.excepthook
    with end_with_any_thread(stop):
        for target in (lambda: None, lambda: sys.exit(0)):
            thread = threading.Thread(target=target)
            thread.start()
            thread.join(PATIENCE)
    assert not stop.is_set()
    assert threading.excepthook is before


def test_what_ends_the_process_itself_is_not_hidden() -> None:
    with pytest.raises(KeyError):
        _live_with(KeyError())
