"""Addresses of a hub, such as ``tcp/127.0.0.1:7447``."""

import ipaddress
import re

from common.errors import InputError

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
_ENDPOINT = re.compile(r"(?:tcp|tls)/(\[[0-9a-fA-F:]+\]|[^\[\]:/\s]+):(\d{1,5})")


def check_endpoint(endpoint: str) -> tuple[str, int]:
    """Return host and port of ``endpoint``.

    Raises:
        InputError: it is not an address.
    """
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None or not 0 < int(match[2]) < 65_536:
        raise InputError(f"{endpoint!r} is no address: write it as {DEFAULT_ENDPOINT}.")
    return match[1].strip("[]"), int(match[2])


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches ``host``."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def from_here(endpoint: str) -> str:
    """Return the address, for this machine's processes, of a hub that listens at ``endpoint``."""
    for every, own in (("0.0.0.0", "127.0.0.1"), ("[::]", "[::1]")):
        endpoint = endpoint.replace(f"/{every}:", f"/{own}:")
    return endpoint
