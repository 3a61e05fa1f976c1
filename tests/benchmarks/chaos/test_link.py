"""A bad network is slow, and loses nothing that it does not send again."""

import random
import socket
from collections import Counter
from types import SimpleNamespace
from typing import Any, cast

import pytest

from benchmarks.chaos.faults import FAULTS
from benchmarks.chaos.link import Link
from common.endpoint import check_endpoint


def test_lost_pieces_wait_as_long_as_tcp_does_and_arrive_in_order() -> None:
    with socket.create_server(("127.0.0.1", 0)) as hub:
        host, port = hub.getsockname()
        with Link(f"tcp/{host}:{port}") as link:
            cluster = cast("Any", SimpleNamespace(links={"actor-1": link}))
            mend = FAULTS["packet loss, 2 to 30 %"].strike(cluster, "actor-1", random.Random(3))
            assert mend is not None
            assert link.delay is not None
            waits = Counter(round(link.delay(), 3) for _ in range(10_000))
            # 0.2 s, then 0.2 + 0.4, and so on: the time-out doubles.
            assert set(waits) <= {0.0, 0.2, 0.6, 1.4, 3.0}
            lost = 1 - waits[0.0] / 10_000
            assert 0.02 < lost < 0.3
            assert waits[0.6] / 10_000 == pytest.approx(lost**2 * (1 - lost), abs=0.01)
            drawn = iter([0.0, 0.2, 0.0])
            link.delay = lambda: next(drawn, 0.0)
            with socket.create_connection(check_endpoint(link.endpoint)) as near:
                far, _ = hub.accept()
                with far:
                    near.sendall(sent := random.Random(1).randbytes(300_000))
                    near.shutdown(socket.SHUT_WR)
                    assert far.makefile("rb").read() == sent
            mend()
            assert link.delay is None
