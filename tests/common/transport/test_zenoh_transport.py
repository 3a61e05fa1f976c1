"""Opening the hub and joining it, by Zenoh."""

import socket

import pytest

from common.errors import InputError
from common.transport.endpoint import DEFAULT_ENDPOINT, check_endpoint
from common.transport.zenoh_transport import ZenohTransport, connect, open_hub
from tests.patience import PATIENCE


@pytest.mark.parametrize(
    "endpoint",
    [
        "",
        "127.0.0.1:7447",
        "tcp/127.0.0.1",
        "tcp/:7447",
        "tcp/127.0.0.1:0",
        "tcp/127.0.0.1:65536",
        "tcp/127.0.0.1:port",
        "tcp/::1:7447",
        "tcp/a b:7447",
        "udp/127.0.0.1:7447",
        "tcp/127.0.0.1:7447/",
        "tcp//127.0.0.1:7447",
    ],
)
def test_what_is_no_address_is_told_with_an_example(endpoint: str) -> None:
    for use in (check_endpoint, open_hub, lambda endpoint: connect(endpoint, 1e9)):
        with pytest.raises(InputError, match=f"is no address: write it as {DEFAULT_ENDPOINT}"):
            use(endpoint)


def test_a_port_that_is_taken_is_told(endpoint: str) -> None:
    with socket.socket() as holder:
        holder.bind(check_endpoint(endpoint))
        holder.listen()
        with pytest.raises(InputError, match=f"^cannot listen at {endpoint} .*--listen"):
            open_hub(endpoint)


def test_two_hubs_cannot_share_an_address(zenoh_hub: ZenohTransport, endpoint: str) -> None:
    with pytest.raises(InputError, match=f"^cannot listen at {endpoint}"):
        open_hub(endpoint)


def test_an_address_can_be_used_again_at_once(endpoint: str) -> None:
    for _ in range(2):
        hub = open_hub(endpoint)
        try:
            client = connect(endpoint, PATIENCE)
            client.close()
        finally:
            hub.close()


def test_an_address_of_another_machine_is_told() -> None:
    # 192.0.2.0/24 is nobody's (RFC 5737).
    with pytest.raises(InputError, match=r"^cannot listen at tcp/192\.0\.2\.1:7447"):
        open_hub("tcp/192.0.2.1:7447")


def test_a_hub_that_is_not_there_is_told_after_the_patience(endpoint: str) -> None:
    with pytest.raises(InputError, match=f"^no hub answered at {endpoint} in .*--connect"):
        connect(endpoint, 0.0)


def test_whoever_wants_to_stop_need_not_wait_for_a_hub(endpoint: str) -> None:
    with pytest.raises(KeyboardInterrupt):
        connect(endpoint, 1e9, lambda: True)


def test_a_hub_that_starts_later_is_waited_for(endpoint: str) -> None:
    hubs: list[ZenohTransport] = []

    def start_one() -> bool:
        if not hubs:  # the one that is there may be slow to answer
            hubs.append(open_hub(endpoint))
        return False

    client = connect(endpoint, PATIENCE, start_one)
    try:
        assert len(hubs) == 1
        assert [str(zid) for zid in client.session.info.routers_zid()] == [
            str(hubs[0].session.info.zid())
        ]
    finally:
        client.close()
        hubs[0].close()
