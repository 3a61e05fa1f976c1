"""Threads that repeat their work, and the end of a process one of whose threads dies."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import ParamSpec

from common.errors import InputError
from common.exit_codes import FAILED

P = ParamSpec("P")


def repeat(
    name: str, seconds: float, work: Callable[[threading.Event], None]
) -> Callable[[], None]:
    """Does ``work`` every so many ``seconds`` in a thread, with an event that is set when the work
    should end. Returns a function that ends the thread and waits for it."""
    ended = threading.Event()

    def run() -> None:
        while not ended.wait(seconds):
            work(ended)

    def end() -> None:
        ended.set()
        thread.join()

    thread = threading.Thread(target=run, name=name, daemon=True)
    thread.start()
    return end


@contextmanager
def end_with_any_thread(stop: threading.Event) -> Iterator[None]:
    """Sets ``stop`` when a thread of this process dies of an exception, and raises the reason here.

    A process that waits for a dead thread would wait for ever. Every thread counts, whatever
    started it, so that none can be forgotten. A thread that may end early catches the exceptions
    that it expects.

    Raises:
        InputError: names the first thread that died, and why, when the block is left. It replaces
            an error of the block that follows from the stop, as of a replay that was closed.
    """
    reasons: list[str] = []
    before = threading.excepthook

    def note(died: threading.ExceptHookArgs) -> None:
        with suppress(OSError):  # if nobody can read it
            before(died)  # prints the traceback
        if issubclass(died.exc_type, SystemExit):
            return
        name = died.thread.name if died.thread is not None else "unknown"
        what = f"{died.exc_type.__name__}: {died.exc_value}".rstrip(".: ")
        reasons.append(f"the thread {name!r} died ({what}): start this process again.")
        stop.set()

    threading.excepthook = note
    try:
        yield
    except (InputError, KeyboardInterrupt):
        if not reasons:
            raise
    finally:
        threading.excepthook = before
    if reasons:
        raise InputError(reasons[0], FAILED)


def guarded(name: str, callback: Callable[P, None]) -> Callable[P, None]:
    """Returns ``callback`` for futures and for threads that are not Python's.

    If a callback raises, Zenoh prints the exception and goes on, and a future logs it. The process
    would work on without what the callback should have done, so an exception counts as the death of
    a thread called ``name``.
    """

    def call(*arguments: P.args, **named: P.kwargs) -> None:
        try:
            callback(*arguments, **named)
        except Exception as error:
            thread = threading.Thread(name=name)
            died = (type(error), error, error.__traceback__, thread)
            threading.excepthook(threading.ExceptHookArgs(died))

    return call
