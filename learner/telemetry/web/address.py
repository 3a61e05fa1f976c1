"""The page's address, and the names under which a browser may ask for it."""

import ipaddress
import re
import socket
from functools import partial

from common.process.http_endpoints import check_address

check_web_address = partial(check_address, flag="--web", usual="127.0.0.1:8080", least_port=0)
"""As `check_address`, where port 0 stands for any that is free."""


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
