"""Addresses of a hub."""

import pytest

from common.endpoint import DEFAULT_ENDPOINT, check_endpoint, from_here
from common.errors import InputError


@pytest.mark.parametrize(
    ("endpoint", "expected"),
    [
        (DEFAULT_ENDPOINT, ("127.0.0.1", 7447)),
        ("tcp/0.0.0.0:1", ("0.0.0.0", 1)),
        ("tcp/hub.example.org:65535", ("hub.example.org", 65_535)),
        ("tcp/[::1]:7447", ("::1", 7447)),
        ("tls/192.0.2.7:7447", ("192.0.2.7", 7447)),
    ],
)
def test_an_address_has_a_host_and_a_port(endpoint: str, expected: tuple[str, int]) -> None:
    assert check_endpoint(endpoint) == expected


@pytest.mark.parametrize("port", ["0", "65536", "99999", "123456"])
def test_what_is_no_port_is_told(port: str) -> None:
    words = rf"^127\.0\.0\.1:{port} has no valid port: choose one from 1 to 65535\.$"
    with pytest.raises(InputError, match=words):
        check_endpoint(f"tcp/127.0.0.1:{port}")


@pytest.mark.parametrize(
    ("listening", "found"),
    [
        ("tcp/0.0.0.0:7447", "tcp/127.0.0.1:7447"),
        ("tls/[::]:1", "tls/[::1]:1"),
        ("tcp/10.0.0.0:7447", "tcp/10.0.0.0:7447"),
        ("tls/hub.example.org:7447", "tls/hub.example.org:7447"),
    ],
)
def test_a_hub_is_found_from_its_own_machine(listening: str, found: str) -> None:
    assert from_here(listening) == found
