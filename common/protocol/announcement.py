"""How a hub tells those who join which run it serves, and under which configuration."""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass

import zenoh

from common.errors import InputError, MessageError
from common.protocol.message import Message
from common.protocol.run_keys import RunKeys
from common.run.config import RunConfig, from_mapping, to_json
from common.transport.bus import check_name

_PAUSE = 0.2


@dataclass(frozen=True)
class Announcement(Message):
    """A run and its configuration, as JSON."""

    run: str
    config: bytes


def encode_announcement(run: str, config: RunConfig) -> bytes:
    return Announcement(run, to_json(config).encode()).encode()


def decode_announcement(payload: bytes) -> tuple[str, RunConfig]:
    """Returns name and configuration of the run.

    Raises:
        MessageError: a malformed message.
        InputError: a configuration that this version does not know.
    """
    told = Announcement.decode(payload)
    try:
        mapping = json.loads(told.config)
    except (ValueError, RecursionError):
        raise MessageError("the configuration is no JSON") from None
    config = from_mapping(RunConfig, mapping, "the hub's configuration")
    config.check()
    return check_name("run", told.run), config


def find_run(
    session: zenoh.Session, name: str | None, patience: float, stopped: Callable[[], bool]
) -> tuple[RunKeys, RunConfig]:
    """The run called ``name``, or the only one, at the hub that ``session`` is connected to.

    Raises:
        InputError: none in ``patience`` seconds, several, or one of another version.
        KeyboardInterrupt: ``stopped`` became true.
    """
    if name is not None:
        check_name("run", name)
    began = time.monotonic()
    while True:
        found: dict[str, RunConfig] = {}
        for reply in session.get(RunKeys(name or "*").config, timeout=2.0):
            if reply.ok is not None:
                try:
                    run, config = decode_announcement(reply.ok.payload.to_bytes())
                except MessageError as error:
                    raise InputError(
                        f"the hub does not speak this version's language ({error}): "
                        "install the same version on both machines."
                    ) from None
                found[run] = config
        if len(found) > 1:
            raise InputError(
                f"the hub serves several runs ({', '.join(sorted(found))}): name one with --run."
            )
        if found:
            run, config = found.popitem()
            return RunKeys(run), config
        if stopped():
            raise KeyboardInterrupt
        if time.monotonic() - began >= patience:
            raise InputError(
                f"the hub serves no run{f' called {name!r}' if name else ''}: "
                "start `python -m learner` there."
            )
        time.sleep(_PAUSE)
