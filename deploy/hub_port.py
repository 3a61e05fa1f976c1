"""`python -m deploy.hub_port N`: prints a port of this machine at which a hub can listen.

A hub whose port is taken ends with an exit code after which it is not restarted, so launchers
choose a free port first.
"""

import sys
from contextlib import suppress

from common.endpoint import check_free
from common.errors import InputError
from common.process.program_end import exit_on_input_error

PORTS = range(20_000, 30_000)
"""Ports for hubs; neither Ray nor Linux assigns them to other programs."""


def free_port(host: str, number: int) -> int:
    """Returns the port in `PORTS` at index ``number``, which wraps around, or the next free port.
    Raises InputError if none is free.

    Args:
        host: an address of this machine; 0.0.0.0 for all addresses.
    """
    for place in range(number, number + len(PORTS)):
        port = PORTS[place % len(PORTS)]
        with suppress(OSError):
            check_free(host, port)
            return port
    raise InputError(
        f"no port from {PORTS.start} to {PORTS.stop - 1} is free at {host}: end what listens there."
    )


if __name__ == "__main__":
    exit_on_input_error(lambda: print(free_port("0.0.0.0", int(sys.argv[1]))))
