"""A hub and a client session of their own for each test that needs Zenoh."""

from collections.abc import Iterator

import pytest
import zenoh

from benchmarks.child import free_endpoint
from common.bus import RunKeys, connect, open_hub

KEYS = RunKeys("r")


@pytest.fixture
def sessions() -> Iterator[tuple[zenoh.Session, zenoh.Session]]:
    """The hub's session and a client's."""
    endpoint = free_endpoint()
    hub = open_hub(endpoint)
    client = connect(endpoint, 60)
    yield hub, client
    client.close()  # type: ignore[no-untyped-call]
    hub.close()  # type: ignore[no-untyped-call]
