"""A hub and a client session of their own for each test that needs Zenoh."""

import pytest
import zenoh

from common.protocol.run_keys import RunKeys

KEYS = RunKeys("r")


@pytest.fixture
def sessions(hub: zenoh.Session, session: zenoh.Session) -> tuple[zenoh.Session, zenoh.Session]:
    """The hub's session and a client's."""
    return hub, session
