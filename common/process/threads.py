"""Threads that do something again and again, and how a process learns that one of them died."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import ParamSpec

from common.errors import InputError
from common.process.exit_codes import FAILED

P = ParamSpec("P")


def repeat(
    name: str, seconds: float, work: Callable[[threading.Event], None]
) -> Callable[[], None]:
    """Does ``work``, whose argument is set once it is to end, every so many seconds in a thread;
    returns what ends that, and waits for it."""
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
    """Set ``stop`` when a thread of this process dies of an exception, and raise the reason here.

    A process that waits for a thread which is no more waits for ever. Any thread counts, whoever
    started it, so that none can be forgotten; one that may end early catches what it expects.

    Raises:
        InputError: the first thread that died and why, once the block is left; also where the block
            then refuses to go on, as with a replay that was closed because ``stop`` was set.
    """
    reasons: list[str] = []
    before = threading.excepthook

    def note(died: threading.ExceptHookArgs) -> None:
        with suppress(OSError):  # nobody can read it
            before(died)  # the traceback
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
    """Returns ``callback`` for threads that are not Python's, and for futures.

    Zenoh prints an exception of a callback and goes on, and a future logs it. So that no process
    works on without what the callback should have done, it counts as the death of thread ``name``.
    """

    def call(*arguments: P.args, **named: P.kwargs) -> None:
        try:
            callback(*arguments, **named)
        except Exception as error:
            thread = threading.Thread(name=name)
            died = (type(error), error, error.__traceback__, thread)
            threading.excepthook(threading.ExceptHookArgs(died))

    return call
