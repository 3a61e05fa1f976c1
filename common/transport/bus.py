"""The Zenoh session and the key expressions of a run.

A star: one hub listens (the process that hosts the replay), all others are its clients. Shared
memory is off because it delivered corrupt data to stalled receivers; scouting is off and the
default address is loopback, so nothing is reachable from outside unless asked for. At addresses
that begin with ``tls/`` everybody shows a certificate, and may do what its role needs.
"""

import json
import re
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import zenoh

from common.errors import InputError
from common.transport.access_control import access_control
from common.transport.credentials import Credentials, Role

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
_NOT_TRUSTED = (
    " If one runs there, its certificates or ours are of another authority or out of date, or the "
    "hub's are not for this address."
)
LEASE_MS = 3_000
"""Silence after which the other side counts as gone."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
_ENDPOINT = re.compile(r"(?:tcp|tls)/(\[[0-9a-fA-F:]+\]|[^\[\]:/\s]+):(\d{1,5})")


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


def from_here(endpoint: str) -> str:
    """Address for this machine's processes of a hub that listens at ``endpoint``."""
    for every, own in (("0.0.0.0", "127.0.0.1"), ("[::]", "[::1]")):
        endpoint = endpoint.replace(f"/{every}:", f"/{own}:")
    return endpoint


def check_certificates(endpoint: str, certificates: Path | None, role: Role) -> Credentials | None:
    """By what a process proves its role at ``endpoint``; None at one where nobody asks.

    Args:
        certificates: the folder that holds them.

    Raises:
        InputError: ``endpoint`` is no address, or it and the certificates do not fit each other.
    """
    check_endpoint(endpoint)
    if endpoint.startswith("tcp/"):
        if certificates is not None:
            raise InputError(f"--certificates are for tls: write {endpoint} as tls{endpoint[3:]}.")
        return None
    if certificates is None:
        raise InputError(
            f"{endpoint} needs --certificates FOLDER: make one with deploy/certificates.sh."
        )
    return Credentials.find(certificates, role)


def _config(mode: str, settings: dict[str, Any]) -> zenoh.Config:
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
        **settings,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def open_hub(endpoint: str, certificates: Path | None = None) -> zenoh.Session:
    """Listen at ``endpoint`` for all processes of the run.

    Args:
        certificates: folder with the hub's, for a ``tls/`` endpoint.

    Raises:
        InputError: the port is taken, the address is not one of this machine's, or the
            certificates cannot be used.
    """
    credentials = check_certificates(endpoint, certificates, "hub")
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
    settings: dict[str, Any] = {"listen/endpoints": [endpoint]}
    if credentials is not None:
        settings |= {**credentials.settings("hub"), "access_control": access_control()}
    try:
        return zenoh.open(_config("router", settings))
    except zenoh.ZError as error:
        raise InputError(f"cannot listen at {endpoint}: {error}") from None


def connect(
    endpoint: str,
    patience: float,
    stopped: Callable[[], bool] = lambda: False,
    *,
    role: Role = "actor",
    certificates: Path | None = None,
) -> zenoh.Session:
    """Join the hub at ``endpoint``, trying again for ``patience`` seconds.

    Args:
        certificates: folder with those of ``role``, for a ``tls/`` endpoint.

    Raises:
        InputError: nobody answered in that time, or the certificates cannot be used.
        KeyboardInterrupt: ``stopped`` became true.
    """
    credentials = check_certificates(endpoint, certificates, role)
    settings: dict[str, Any] = {
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 1000,
        "connect/exit_on_failure": True,
        "connect/retry": {
            "period_init_ms": 100,
            "period_max_ms": 500,
            "period_increase_factor": 2,
        },
    }
    if credentials is not None:
        settings |= credentials.settings(role)
    config = _config("client", settings)
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
                    + ("" if credentials is None else _NOT_TRUSTED)
                ) from None
