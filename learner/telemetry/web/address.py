"""The page's address, and the names under which a browser may ask for it."""

import ipaddress
import re
import socket

from common.errors import InputError

_ADDRESS = re.compile(r"(\[[0-9a-fA-F:]+\]|[A-Za-z0-9._-]+):(\d{1,5})")


def check_address(address: str) -> tuple[str, int]:
    """Returns host and port of ``address``.

    Raises:
        InputError: it is not one.
    """
    match = _ADDRESS.fullmatch(address)
    if match is None or int(match[2]) > 65_535:
        raise InputError(f"--web {address} is no address: write it as --web 127.0.0.1:8080.")
    return match[1].strip("[]"), int(match[2])


def may_be_asked_as(header: str, host: str) -> bool:
    """Whether a browser that asks with this Host header meant us, who listen at ``host``.

    A stranger's page may have its own name lead to our address (DNS rebinding), and then read us
    as itself; a number leads nowhere else.
    """
    asked = re.sub(r":\d*$", "", header.strip()).strip("[]").lower()
    try:
        ipaddress.ip_address(asked)
    except ValueError:
        return asked in {"localhost", host.lower(), socket.gethostname().lower()}
    return True
