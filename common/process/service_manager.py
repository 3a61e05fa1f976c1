"""Notifies the service manager that started this process, by the protocol of systemd's sd_notify.

Without a service manager (``NOTIFY_SOCKET`` is not set), nothing is sent.
"""

import contextlib
import os
import socket

_ADDRESS = "NOTIFY_SOCKET"


def tell(*assignments: str) -> None:
    """Sends ``READY=1``, ``STATUS=…``, ``WATCHDOG=1`` or ``STOPPING=1``."""
    address = os.environ.get(_ADDRESS, "")
    if not address.startswith(("/", "@")):
        return
    with (
        contextlib.suppress(OSError),  # the process works without it
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as to,
    ):
        to.setblocking(False)
        to.sendto("\n".join(assignments).encode(), address.replace("@", "\0", 1))


def alive() -> None:
    """Says that the process works, or waits for something that it cannot hasten."""
    tell("WATCHDOG=1")


def without(environment: dict[str, str]) -> dict[str, str]:
    """Returns ``environment`` for a child, without the service manager's variables."""
    ours = (_ADDRESS, "WATCHDOG_USEC", "WATCHDOG_PID")
    return {name: value for name, value in environment.items() if name not in ours}
