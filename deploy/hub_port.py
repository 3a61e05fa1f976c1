"""`python -m deploy.hub_port N`: a port of this machine at which a hub can listen.

A hub whose port is taken ends with an exit code by which nobody starts it again, so launchers that
choose its port look first.
"""

import sys
from contextlib import suppress

from common.errors import InputError, exit_on_input_error
from common.transport.endpoint import check_free

PORTS = range(20_000, 30_000)
"""Ports of hubs; neither Ray nor Linux chooses one of them by itself."""


def free_port(host: str, number: int) -> int:
    """Returns the port in `PORTS` that ``number`` stands for, or the next one that is free. Raises
    InputError if none is free.

    Args:
        host: an address of this machine, 0.0.0.0 for all of them.
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
