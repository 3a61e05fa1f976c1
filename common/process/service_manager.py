"""What a process tells the service manager that started it: the protocol of systemd's sd_notify.

Nothing is told where there is none (``NOTIFY_SOCKET`` is not set).
"""

import contextlib
import os
import socket

_ADDRESS = "NOTIFY_SOCKET"


def tell(*assignments: str) -> None:
    """Send ``READY=1``, ``STATUS=…``, ``WATCHDOG=1`` or ``STOPPING=1``."""
    address = os.environ.get(_ADDRESS, "")
    if not address.startswith(("/", "@")):
        return
    with (
        contextlib.suppress(OSError),  # it has gone, which is no reason to end
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as to,
    ):
        to.setblocking(False)
        to.sendto("\n".join(assignments).encode(), address.replace("@", "\0", 1))


def alive() -> None:
    """Say that the process works, or waits for what it can only wait for."""
    tell("WATCHDOG=1")


def without(environment: dict[str, str]) -> dict[str, str]:
    """Returns the environment of a child, for which the service manager does not wait."""
    ours = (_ADDRESS, "WATCHDOG_USEC", "WATCHDOG_PID")
    return {name: value for name, value in environment.items() if name not in ours}
