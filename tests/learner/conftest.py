"""A hub and a client session of their own for each test that needs Zenoh."""

import socket
from collections.abc import Iterator

import pytest
import zenoh

from common.bus import RunKeys, connect, open_hub

KEYS = RunKeys("r")


@pytest.fixture
def sessions() -> Iterator[tuple[zenoh.Session, zenoh.Session]]:
    """The hub's session and a client's."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    hub = open_hub(endpoint)
    client = connect(endpoint, 60)
    yield hub, client
    client.close()  # type: ignore[no-untyped-call]
    hub.close()  # type: ignore[no-untyped-call]
