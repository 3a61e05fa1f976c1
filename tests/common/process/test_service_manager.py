"""What a service manager is told, heard at a socket as systemd's."""

import socket
from pathlib import Path

import pytest

from common.process.service_manager import alive, tell, without


@pytest.mark.parametrize("abstract", [False, True])
def test_what_is_told_is_heard(
    abstract: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    address = f"@{tmp_path}" if abstract else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(address.replace("@", "\0", 1))
        monkeypatch.setenv("NOTIFY_SOCKET", address)
        tell("READY=1", "STATUS=ε is 1")
        alive()
        assert manager.recv(1_000) == "READY=1\nSTATUS=ε is 1".encode()
        assert manager.recv(1_000) == b"WATCHDOG=1"


@pytest.mark.parametrize("address", [None, "", "no path", "/nobody/listens"])
def test_nobody_is_told_where_there_is_nobody(
    address: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    if address is None:
        monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    else:
        monkeypatch.setenv("NOTIFY_SOCKET", address)
    tell("READY=1")


def test_children_do_not_speak_for_their_parent() -> None:
    assert without({"NOTIFY_SOCKET": "/x", "WATCHDOG_PID": "1", "HOME": "/"}) == {"HOME": "/"}
