"""A hub of which strangers would have all files."""

import socket
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest

from common.endpoint import check_endpoint
from common.protocol.run_keys import RunKeys
from common.transport import zenoh_sessions
from common.transport.hub_sockets import open_files
from common.transport.zenoh_sessions import connect, open_hub
from common.transport.zenoh_transport import ZenohTransport
from tests.patience import PATIENCE, wait_until

KEY = RunKeys("r").insert("left")
_SOME = 50


@pytest.mark.parametrize("safe", [False, True])
def test_strangers_are_not_let_in_where_they_are_too_many_and_all_others_go_on(
    safe: bool,
    address: str,
    named: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    address, folder = (address, named) if safe else (address.replace("tls", "tcp"), None)
    host, port = check_endpoint(address)
    with ExitStack() as stack:

        def actor(name: str) -> ZenohTransport:
            client = connect(address, PATIENCE, name=name, certificates=folder)
            return stack.enter_context(client)

        most = (open_files() + 2 * _SOME) * 8 // 5
        monkeypatch.setattr(zenoh_sessions, "most_files", lambda: most)
        hub = stack.enter_context(open_hub(address, folder))
        hub.serve(KEY, lambda _: b"ok")
        left = actor("left").requester(KEY, PATIENCE)
        assert left.request(b"").result().payload == b"ok"
        strangers = []
        while "nobody is let in at port" not in caplog.text:
            strangers.append(stack.enter_context(socket.socket()))
            strangers[-1].setblocking(False)
            with suppress(BlockingIOError):
                strangers[-1].connect((host, port))
            wait_until(lambda: _is_in(strangers[-1]) or "nobody" in caplog.text, "it is let in")
        assert len(strangers) > 5
        late = stack.enter_context(socket.socket())
        late.settimeout(0.1)
        with pytest.raises(TimeoutError):
            late.connect((host, port))
        assert left.request(b"").result().payload == b"ok"
        for stranger in strangers:
            stranger.close()
        actor("right")  # is let in once some of them have ended


def _is_in(stranger: socket.socket) -> bool:
    with suppress(OSError):
        stranger.getpeername()
        return True
    return False
