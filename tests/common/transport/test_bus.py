"""Opening the hub and joining it; names, addresses and keys."""

import socket
import time

import pytest
import zenoh

from common.errors import InputError
from common.protocol.run_keys import RunKeys
from common.transport.bus import (
    DEFAULT_ENDPOINT,
    check_endpoint,
    check_name,
    connect,
    from_here,
    open_hub,
)
from tests.patience import PATIENCE


@pytest.mark.parametrize("name", ["a", "7", "robot-pong.2_b", "A" * 64])
def test_a_name_that_fits_is_kept(name: str) -> None:
    assert check_name("run", name) == name


@pytest.mark.parametrize(
    "name",
    ["", ".", "..", "-a", "_a", "a/b", "a b", "a*", "*", "a$*", "a#", "a?", "ä", "a\n", "A" * 65],
)
def test_a_name_that_could_be_a_path_or_a_pattern_is_refused(name: str) -> None:
    with pytest.raises(InputError, match=r"^actor .* cannot be used: up to 64 letters"):
        check_name("actor", name)


@pytest.mark.parametrize(
    ("endpoint", "expected"),
    [
        (DEFAULT_ENDPOINT, ("127.0.0.1", 7447)),
        ("tcp/0.0.0.0:1", ("0.0.0.0", 1)),
        ("tcp/hub.example.org:65535", ("hub.example.org", 65_535)),
        ("tcp/[::1]:7447", ("::1", 7447)),
        ("tls/192.0.2.7:7447", ("192.0.2.7", 7447)),
    ],
)
def test_an_address_has_a_host_and_a_port(endpoint: str, expected: tuple[str, int]) -> None:
    assert check_endpoint(endpoint) == expected


@pytest.mark.parametrize(
    ("listening", "found"),
    [
        ("tcp/0.0.0.0:7447", "tcp/127.0.0.1:7447"),
        ("tls/[::]:1", "tls/[::1]:1"),
        ("tcp/10.0.0.0:7447", "tcp/10.0.0.0:7447"),
        ("tls/hub.example.org:7447", "tls/hub.example.org:7447"),
    ],
)
def test_a_hub_is_found_from_its_own_machine(listening: str, found: str) -> None:
    assert from_here(listening) == found


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


def test_two_hubs_cannot_share_an_address(hub: zenoh.Session, endpoint: str) -> None:
    with pytest.raises(InputError, match=f"^cannot listen at {endpoint}"):
        open_hub(endpoint)


def test_an_address_can_be_used_again_at_once(endpoint: str) -> None:
    for _ in range(2):
        hub = open_hub(endpoint)
        try:
            client = connect(endpoint, PATIENCE)
            client.close()  # type: ignore[no-untyped-call]
        finally:
            hub.close()  # type: ignore[no-untyped-call]


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
    hubs: list[zenoh.Session] = []

    def start_one() -> bool:
        if not hubs:  # the one that is there may be slow to answer
            hubs.append(open_hub(endpoint))
        return False

    client = connect(endpoint, PATIENCE, start_one)
    try:
        assert len(hubs) == 1
        assert [str(zid) for zid in client.info.routers_zid()] == [str(hubs[0].info.zid())]
    finally:
        client.close()  # type: ignore[no-untyped-call]
        hubs[0].close()  # type: ignore[no-untyped-call]


def test_the_clients_of_a_hub_reach_each_other(
    hub: zenoh.Session, session: zenoh.Session, endpoint: str
) -> None:
    def answer(query: zenoh.Query) -> None:
        query.reply("ale-robot/r/config", b"here")

    other = connect(endpoint, PATIENCE)
    try:
        other.declare_queryable("ale-robot/r/config", answer)
        found: list[bytes] = []
        ends = time.monotonic() + PATIENCE
        while not found and time.monotonic() < ends:  # the hub may not have heard of it yet
            replies = session.get("ale-robot/*/config", timeout=20.0)
            found = [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]
        assert found == [b"here"]
    finally:
        other.close()  # type: ignore[no-untyped-call]


def all_keys(run: str) -> list[str]:
    keys = RunKeys(run)
    return [
        keys.config,
        keys.insert("a"),
        keys.sample,
        keys.priorities,
        keys.held_out,
        keys.progress,
        keys.weights,
        keys.latest_weights,
        keys.task,
        keys.report,
        keys.live("actor", "a"),
        keys.stats("actor", "a"),
    ]


def test_every_key_of_a_run_is_its_own() -> None:
    keys = [zenoh.KeyExpr(key) for key in all_keys("r") + all_keys("s")]
    for i, one in enumerate(keys):
        assert zenoh.KeyExpr("ale-robot/*/**").includes(one)
        for other in keys[:i]:
            assert not one.intersects(other)


def test_a_star_stands_for_every_actor_and_run() -> None:
    keys = RunKeys("r")
    served = zenoh.KeyExpr(keys.insert("*"))
    assert served.includes(zenoh.KeyExpr(keys.insert("a")))
    assert not served.intersects(zenoh.KeyExpr(RunKeys("s").insert("a")))
    anywhere = zenoh.KeyExpr(RunKeys("*").config)
    assert [key for key in all_keys("r") if anywhere.intersects(zenoh.KeyExpr(key))] == [
        keys.config
    ]
