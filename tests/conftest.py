"""For all tests: Zenoh for those that want it, and no test by the clock.

Zenoh is a free address, a hub that listens there, and a client.
"""

from collections.abc import Iterator

import pytest
import zenoh
from hypothesis import HealthCheck, settings

from benchmarks.child import free_endpoint
from common.transport import bus
from common.transport.bus import connect, open_hub

# A busy machine may take its time over an example.
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("patient")
# Nor does a link break because the machine stood still for some seconds.
bus.LEASE_MS = 60_000


@pytest.fixture
def endpoint() -> str:
    """An address of this machine at which nobody listens."""
    return free_endpoint()


@pytest.fixture
def hub(endpoint: str) -> Iterator[zenoh.Session]:
    session = open_hub(endpoint)
    yield session
    session.close()  # type: ignore[no-untyped-call]


@pytest.fixture
def session(hub: zenoh.Session, endpoint: str) -> Iterator[zenoh.Session]:
    """A client of ``hub``."""
    session = connect(endpoint, 60.0)
    yield session
    session.close()  # type: ignore[no-untyped-call]
