"""The Zenoh session and the key expressions of a run.

A star: one hub listens (the process that hosts the replay), all others are its clients. Shared
memory is off because it delivered corrupt data to stalled receivers; scouting is off and the
default address is loopback, so nothing is reachable from outside unless asked for.
"""

import json
import re
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass

import zenoh

from common.errors import InputError

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
NAMESPACE = "ale-robot"
LEASE_MS = 3_000
"""Silence after which the other side counts as gone."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
_ENDPOINT = re.compile(r"tcp/(\[[0-9a-fA-F:]+\]|[^\[\]:/\s]+):(\d{1,5})")


def check_name(kind: str, name: str) -> str:
    """``name`` if it can be part of a key expression and of a path.

    Raises:
        InputError: it cannot; ``kind`` says what was being named.
    """
    if not _NAME.fullmatch(name):
        raise InputError(
            f"{kind} {name!r} cannot be used: up to 64 letters, digits, '.', '_' or '-', "
            "a letter or digit first."
        )
    return name


def check_endpoint(endpoint: str) -> tuple[str, int]:
    """Host and port of a Zenoh endpoint such as ``tcp/127.0.0.1:7447``."""
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None or not 0 < int(match[2]) < 65_536:
        raise InputError(f"{endpoint!r} is no address: write it as {DEFAULT_ENDPOINT}.")
    return match[1].strip("[]"), int(match[2])


@dataclass(frozen=True)
class RunKeys:
    """Key expressions of one run, all under ``ale-robot/<run>``."""

    run: str

    def _key(self, *parts: str) -> str:
        return "/".join((NAMESPACE, self.run, *parts))

    @property
    def config(self) -> str:
        """Query: the run's `RunConfig`; ``RunKeys('*').config`` finds the run itself."""
        return self._key("config")

    def insert(self, actor: str) -> str:
        """Query with a chunk, answered when it is stored; ``'*'`` for the server's side."""
        return self._key("insert", actor)

    @property
    def sample(self) -> str:
        """Query for a minibatch."""
        return self._key("sample")

    @property
    def priorities(self) -> str:
        """Query with new priorities of sampled steps."""
        return self._key("priorities")

    @property
    def held_out(self) -> str:
        """Query for states on which the mean max-Q is measured."""
        return self._key("held_out")

    @property
    def progress(self) -> str:
        """Query for the replay's counters; the learner also tells its own state with it."""
        return self._key("progress")

    @property
    def weights(self) -> str:
        """Published: the newest weights, version in the attachment."""
        return self._key("weights")

    @property
    def latest_weights(self) -> str:
        """Query: the newest weights, for those who missed the broadcast."""
        return self._key("latest_weights")

    @property
    def task(self) -> str:
        """Query of an evaluator: which epoch to test next, with that epoch's weights."""
        return self._key("task")

    @property
    def report(self) -> str:
        """Query of an evaluator with the games it played."""
        return self._key("report")

    def live(self, role: str, name: str) -> str:
        """Liveliness token of a process."""
        return self._key("live", role, name)

    def stats(self, role: str, name: str) -> str:
        """Published: a process' own counters, about once a second."""
        return self._key("stats", role, name)


def _session_config(mode: str) -> zenoh.Config:
    config = zenoh.Config()
    settings = {
        "mode": mode,
        "listen/endpoints": [],
        "connect/endpoints": [],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,  # nobody is looked for, so there is nothing to wait for
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": LEASE_MS,
        # Of 64 KB each: a minibatch leaves in one go, not two at a time.
        "transport/link/tx/queue/size/data": 16,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def open_hub(endpoint: str) -> zenoh.Session:
    """Listen at ``endpoint`` for all processes of the run.

    Raises:
        InputError: the port is taken, or the address is not one of this machine's.
    """
    host, port = check_endpoint(endpoint)
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except OSError as error:
        raise InputError(
            f"cannot listen at {endpoint} ({error.strerror}): "
            "another learner or replay may be running there; choose another with --listen."
        ) from None
    config = _session_config("router")
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise InputError(f"cannot listen at {endpoint}: {error}") from None


def connect(
    endpoint: str, patience: float, stopped: Callable[[], bool] = lambda: False
) -> zenoh.Session:
    """Join the hub at ``endpoint``, trying again for ``patience`` seconds.

    Raises:
        InputError: nobody answered in that time.
        KeyboardInterrupt: ``stopped`` became true.
    """
    check_endpoint(endpoint)
    config = _session_config("client")
    settings = {
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 1000,
        "connect/exit_on_failure": True,
        "connect/retry": {
            "period_init_ms": 100,
            "period_max_ms": 500,
            "period_increase_factor": 2,
        },
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    began = time.monotonic()
    while True:
        try:
            return zenoh.open(config)
        except zenoh.ZError:
            if stopped():
                raise KeyboardInterrupt from None
            waited = time.monotonic() - began
            if waited >= patience:
                raise InputError(
                    f"no hub answered at {endpoint} in {waited:.0f} s: start `python -m learner` "
                    "there, or name its address with --connect."
                ) from None
