"""For all tests: a hub and a client, within this process or by Zenoh; no test by the clock."""

import subprocess
import sys
from collections.abc import Iterator
from multiprocessing import forkserver
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from benchmarks.child import free_endpoint
from common.transport import zenoh_sessions
from common.transport.interface import Transport
from common.transport.zenoh_sessions import connect, open_hub
from common.transport.zenoh_transport import ZenohTransport
from tests.certificates import certify
from tests.forked import FORKING
from tests.in_process_transport import InProcessHub
from tests.patience import PATIENCE

# A busy machine may take its time over an example.
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("patient")
# Nor does a link break because the machine stood still for some seconds.
zenoh_sessions.LEASE_MS = 60_000


def pytest_runtest_setup() -> None:
    """On a busy machine two threads of PyTorch wait for each other at every layer."""
    if torch := sys.modules.get("torch"):
        torch.set_num_threads(1)


@pytest.fixture
def meeting() -> InProcessHub:
    """Where ``hub`` and ``client`` meet, and others may join them."""
    return InProcessHub()


@pytest.fixture
def hub(meeting: InProcessHub) -> Iterator[Transport]:
    """The transport of the process that hosts the replay."""
    with meeting.connect() as transport:
        yield transport


@pytest.fixture
def client(meeting: InProcessHub, hub: Transport) -> Iterator[Transport]:
    """The transport of another process."""
    with meeting.connect() as transport:
        yield transport


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Those of a hub, its learner and its actors, which no test changes."""
    return certify(tmp_path_factory.mktemp("certificates"))


@pytest.fixture
def endpoint() -> str:
    """An address of this machine at which nobody listens."""
    return free_endpoint()


@pytest.fixture
def zenoh_hub(endpoint: str) -> Iterator[ZenohTransport]:
    with open_hub(endpoint) as transport:
        yield transport


@pytest.fixture
def zenoh_client(zenoh_hub: ZenohTransport, endpoint: str) -> Iterator[ZenohTransport]:
    """A client of ``zenoh_hub``."""
    with connect(endpoint, PATIENCE) as transport:
        yield transport


@pytest.fixture
def forks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forks the programs that would be started, so that none need import anything."""
    forkserver.ensure_running()  # before the test changes what a process inherits
    for name, member in FORKING.items():
        monkeypatch.setattr(subprocess.Popen, name, member, raising=False)
