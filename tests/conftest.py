"""Zenoh for every test that wants it: a free address, a hub that listens there, and a client."""

import socket
from collections.abc import Iterator

import pytest
import zenoh

from common.bus import connect, open_hub


@pytest.fixture
def endpoint() -> str:
    """An address of this machine at which nobody listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture
def hub(endpoint: str) -> Iterator[zenoh.Session]:
    session = open_hub(endpoint)
    yield session
    session.close()  # type: ignore[no-untyped-call]


@pytest.fixture
def session(hub: zenoh.Session, endpoint: str) -> Iterator[zenoh.Session]:
    """A client of ``hub``."""
    session = connect(endpoint, 10.0)
    yield session
    session.close()  # type: ignore[no-untyped-call]
