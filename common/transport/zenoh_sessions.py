"""Opens Zenoh sessions: the hub of a run, the connections of all others, and routers between them.

The topology is a star: one hub listens (the process that hosts the replay), and all others are its
clients. Shared memory is off because it delivered corrupt data to stalled receivers. Scouting is
off and the default address is loopback, so nothing is reachable from outside unless asked for. At
addresses that begin with ``tls/``, every process shows a certificate, and may do what its role
needs.
"""

import errno
import json
import logging
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import zenoh

from common.endpoint import check_endpoint, check_free, is_known, is_loopback
from common.errors import InputError, Unreachable
from common.transport.access_control import (
    LONGEST_RECEIVED,
    MAX_SESSIONS,
    access_control,
    rate_limits,
    size_limits,
)
from common.transport.credentials import (
    Role,
    allowed_actors,
    allowed_runs,
    check_certificates,
    common_name,
)
from common.transport.file_guard import FileGuard
from common.transport.flood_guard import FloodGuard, tolerated
from common.transport.hub_sockets import forget_the_silent, most_files
from common.transport.leaky_bucket import ACTOR_QUOTA
from common.transport.zenoh_transport import ZenohTransport

LEASE_MS = 3_000
"""Silence after which the other side counts as gone, ms."""
_log = logging.getLogger(__name__)
_NOT_TRUSTED = (
    " If one runs there, its certificates or ours are of another authority or out of date, or the "
    "hub's are not for this address."
)
_NOT_ENCRYPTED = " If one runs there, its address may begin with tls/."


def _config(mode: str, settings: dict[str, Any]) -> zenoh.Config:
    config = zenoh.Config()
    settings = {
        "mode": mode,
        "listen/endpoints": [],
        "connect/endpoints": [],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,  # without scouting there is nothing to wait for
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/rx/max_message_size": LONGEST_RECEIVED,
        # Queue entries have 64 KB: with 16, a minibatch leaves in one go, not two at a time.
        "transport/link/tx/queue/size/data": 16,
        **settings,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _joining(endpoint: str) -> dict[str, Any]:
    return {
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 1000,
        "connect/exit_on_failure": True,
        "connect/retry": {
            "period_init_ms": 100,
            "period_max_ms": 500,
            "period_increase_factor": 2,
        },
    }


def _listening(endpoint: str, files: int) -> dict[str, Any]:
    # Zenoh's default of 1,000 would exclude the last of 1,024 actors.
    sessions = min(MAX_SESSIONS, files * 3 // 8)
    if sessions < MAX_SESSIONS:
        text = (
            "%s takes at most %d processes, because this one may have %d open files: raise the "
            "hard limit (ulimit -n) for more"
        )
        _log.warning(text, endpoint, sessions, files)
    return {
        "listen/endpoints": [endpoint],
        "transport/unicast/max_sessions": sessions,
        "transport/unicast/accept_pending": sessions,  # after a restart, all may come at once
        **size_limits(),
    }


def open_router(endpoint: str, hub: str) -> ZenohTransport:
    """Listens at ``endpoint`` for processes, and relays messages between them and the hub.

    It joins ``hub`` whenever that is there. It works only at ``tcp/`` addresses: a hub knows by
    certificate which process is at the other end of a connection, and behind a router there are
    many.
    """
    settings = {
        **_joining(hub),
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        **_listening(endpoint, most_files()),
    }
    return ZenohTransport(zenoh.open(_config("router", settings)))


def open_hub(
    endpoint: str,
    certificates: Path | None = None,
    most: float = tolerated(ACTOR_QUOTA),
    run: str | None = None,
) -> ZenohTransport:
    """Listens at ``endpoint`` for all processes of the run. Raises InputError if the port is taken,
    the address does not belong to this machine, or the certificates cannot be used.

    Args:
        certificates: folder with the hub's certificates, for a ``tls/`` endpoint.
        most: maximum bytes per second of an actor with a certificate by name; one that sends more
            is cut off for a while.
        run: the hub's own run, for which no other replay may answer.
    """
    credentials = check_certificates(endpoint, certificates, "hub")
    host, port = check_endpoint(endpoint)
    if credentials is None and not is_loopback(host):
        _log.warning(
            "whoever reaches %s can send chunks and weights: use a tls/ address "
            "(deploy/README.md), or a network whose machines you trust",
            endpoint,
        )
    try:
        check_free(host, port)
    except OSError as error:
        if error.errno == errno.EADDRNOTAVAIL:
            everywhere = f"{endpoint.partition('/')[0]}/0.0.0.0:{port}"
            raise InputError(
                f"cannot listen at {endpoint}: {host} is not an address of this machine; choose "
                f"one that is, or listen at all of them by --listen {everywhere}."
            ) from None
        another = f"{endpoint.rpartition(':')[0]}:{port + (1 if port < 65_535 else -1)}"
        raise InputError(
            f"cannot listen at {endpoint} ({error.strerror}): another learner or replay may be "
            f"running there; choose another address, as by --listen {another}."
        ) from None
    files = most_files()
    settings = {**_listening(endpoint, files), "downsampling": rate_limits()}
    let_in, by_name = None, set[str]()
    if credentials is not None and certificates is not None:
        actors = allowed_actors(certificates, listed=True)
        access = access_control(actors, allowed_runs(certificates, run))
        settings |= {**credentials.settings("hub"), "access_control": access}
        let_in = {subject["id"] for subject in access["subjects"]}
        by_name = {common_name("actor", name) for name in actors or ()}
    # Controlled by RUST_LOG; denied messages are reported only there.
    zenoh.try_init_log_from_env()  # type: ignore[no-untyped-call]
    try:
        session = zenoh.open(_config("router", settings))
    except zenoh.ZError as error:
        raise InputError(f"cannot listen at {endpoint}: {error}") from None
    with ExitStack() as undo:
        guard = None if let_in is None else FloodGuard(port, let_in - by_name, most)
        transport = undo.enter_context(ZenohTransport(session, let_in, guard))
        forget_the_silent(port, LEASE_MS)
        transport.keep(FileGuard(port, files))
        if guard is not None:
            transport.watch_links(guard.hear)
        undo.pop_all()
    return transport


def connect(
    endpoint: str,
    patience: float,
    stopped: Callable[[], bool] = lambda: False,
    *,
    role: Role = "actor",
    name: str | None = None,
    certificates: Path | None = None,
) -> ZenohTransport:
    """Joins the hub at ``endpoint``, trying for up to ``patience`` seconds.

    Args:
        name: name of an actor, which may have a certificate of its own, or of a replay's run.
        certificates: folder with the certificates of ``role``, for a ``tls/`` endpoint.

    Raises:
        InputError: there was no answer in that time, or the certificates cannot be used.
        KeyboardInterrupt: ``stopped`` became true.
    """
    credentials = check_certificates(endpoint, certificates, role, name)
    settings = _joining(endpoint)
    if credentials is not None:
        settings |= credentials.settings(role)
    config = _config("client", settings)
    began = time.monotonic()
    while True:
        try:
            return ZenohTransport(zenoh.open(config), connects=True)
        except zenoh.ZError:
            if stopped():
                raise KeyboardInterrupt from None
            waited = time.monotonic() - began
            if waited >= patience:
                host, _ = check_endpoint(endpoint)
                if not is_known(host):
                    raise Unreachable(
                        f"this machine knows no host called {host}: name the hub's address with "
                        "--connect."
                    ) from None
                raise Unreachable(
                    f"no hub answered at {endpoint} in {waited:.0f} s: start a learner "
                    "there, or name its address with --connect."
                    + (_NOT_ENCRYPTED if credentials is None else _NOT_TRUSTED)
                ) from None
