"""Joins a run: finds which run a hub serves, and its configuration."""

import logging
import math
import threading
import time
from collections.abc import Callable
from pathlib import Path

from common.errors import InputError, MessageError, Unreachable
from common.process.log_lines import Seldom, say_aside
from common.protocol.run_keys import RunKeys, check_name
from common.run.announcement import Announcement
from common.schedule import Every, Now
from common.settings.config import RunConfig
from common.transport.interface import Transport
from common.version import other_version

_log = logging.getLogger(__name__)
_log.addFilter(Seldom())
_DEADLINE = 2.0
_PAUSE = 0.2
_TELL_EVERY = 10.0
_DENIED = (
    " If one runs there, it does not admit our certificate: use that of a learner, or of an actor "
    "whose name it lists (deploy/README.md)."
)


def patiently(
    stop: threading.Event,
    endpoint: str,
    patience: float = math.inf,
    say: Callable[[str], None] = say_aside,
    now: Now = time.monotonic,
) -> Callable[[], bool]:
    """Returns a function that says whether ``stop`` is set, for callers that wait for a run and ask
    after each attempt. At the first call, and then every 10 s, it prints that they wait, and for
    how much longer they do so at most, of ``patience`` seconds in all."""
    reminder, ends = Every(_TELL_EVERY, now), now() + patience
    hint = ": a learner at another address is named by --connect"

    def stopped() -> bool:
        nonlocal hint
        if not stop.is_set() and reminder.is_due():
            left = f" at most {math.ceil(max(ends - now(), 0.0))} s" if math.isfinite(ends) else ""
            say(f"waiting{left} for a run at {endpoint}{hint}; Ctrl-C ends it.")
            hint = ""
        return stop.is_set()

    return stopped


def find_run(
    transport: Transport,
    name: str | None,
    patience: float,
    stopped: Callable[[], bool] = lambda: False,
    certificates: Path | None = None,
) -> tuple[RunKeys, RunConfig]:
    """Returns the run called ``name``, or the only run, at the hub of ``transport``.

    A run of another version, or whose settings cannot work here, is refused at once if it is named.
    Without a name it is passed over, and logged while no other run is found.

    Args:
        certificates: folder of the certificates with which this process connected. A hub does not
            answer roles that may not ask.

    Raises:
        InputError: there is no run within ``patience`` seconds, or several, or none that can work
            here.
        KeyboardInterrupt: ``stopped`` became true.
    """
    if name is not None:
        check_name("run", name)
    began = time.monotonic()
    others: list[str] = []
    while True:
        found, unfit = _announced(transport, RunKeys(name or "*").config)
        if len(found) > 1:
            raise InputError(
                f"the hub serves several runs ({', '.join(sorted(found))}): name one with --run."
            )
        if found:
            _, told = found.popitem()
            return RunKeys(told.run, told.run_id), told.config
        over = time.monotonic() - began >= patience
        if unfit and (over or name is not None):
            raise unfit[min(unfit)]
        if name is not None and not others:
            others = sorted(_announced(transport, RunKeys("*").config)[0])
            if others:
                _log.warning("the hub serves %s, and no run called %s", " and ".join(others), name)
        if stopped():
            raise KeyboardInterrupt
        if over:
            called = f" called {name!r}" if name else ""
            instead = f", but {' and '.join(others)}: name one with --run, or" if others else ":"
            raise Unreachable(
                f"the hub serves no run{called}{instead} start a learner there."
                + ("" if certificates is None else _DENIED)
            )
        for key, reason in unfit.items():
            _log.warning("what %s announces is passed over: %s", key, reason)
        time.sleep(_PAUSE)


def _announced(
    transport: Transport, key: str
) -> tuple[dict[str, Announcement], dict[str, InputError]]:
    """Returns the runs that are announced under ``key``, by name; and by their own key, why others
    cannot be joined from here."""
    found: dict[str, Announcement] = {}
    unfit: dict[str, InputError] = {}
    for answer in transport.gather(key, _DEADLINE):
        try:
            told = Announcement.decode(answer.payload)
        except MessageError as error:
            unfit[answer.key] = InputError(
                f"{other_version(error)}, or name another hub with --connect."
            )
        except InputError as error:
            unfit[answer.key] = error
        else:
            if answer.key == RunKeys(told.run).config:  # otherwise it claims another run's name
                found[told.run] = told
    return found, unfit
