"""Finding a run at a hub, over Zenoh."""

from dataclasses import replace

import pytest
import zenoh
from zenoh.handlers import Callback

from common.errors import InputError, MessageError
from common.protocol.announcement import decode_announcement, encode_announcement, find_run
from common.protocol.run_keys import RunKeys
from common.protocol.wire import SCHEMA, pack
from common.run.config import to_json
from common.run.presets import PRESETS
from tests.patience import PATIENCE

FAST, PAPER = PRESETS["fast"], PRESETS["paper"]


def announce(hub: zenoh.Session, run: str, answer: bytes) -> zenoh.Queryable[None]:
    """Answer as the hub of ``run``, for as long as its session is open."""

    def reply(query: zenoh.Query) -> None:
        with query:
            query.reply(RunKeys(run).config, answer)

    return hub.declare_queryable(RunKeys(run).config, Callback(reply, indirect=False))


def never() -> bool:
    return False


@pytest.mark.parametrize("name", list(PRESETS))
def test_a_configuration_is_announced_whole(name: str) -> None:
    config = PRESETS[name]  # type: ignore[index]
    assert decode_announcement(encode_announcement("run-1", config)) == ("run-1", config)


def test_a_run_is_found_by_its_name(hub: zenoh.Session, session: zenoh.Session) -> None:
    announce(hub, "one", encode_announcement("one", FAST))
    announce(hub, "two", encode_announcement("two", PAPER))
    assert find_run(session, "one", PATIENCE, never) == (RunKeys("one"), FAST)
    assert find_run(session, "two", PATIENCE, never) == (RunKeys("two"), PAPER)


def test_the_only_run_is_found_without_a_name(hub: zenoh.Session, session: zenoh.Session) -> None:
    announce(hub, "one", encode_announcement("one", PAPER))
    assert find_run(session, None, PATIENCE, never) == (RunKeys("one"), PAPER)


def test_of_several_runs_one_must_be_named(hub: zenoh.Session, session: zenoh.Session) -> None:
    announce(hub, "two", encode_announcement("two", FAST))
    announce(hub, "one", encode_announcement("one", FAST))
    with pytest.raises(InputError, match=r"several runs \(one, two\): name one with --run"):
        find_run(session, None, PATIENCE, never)


def test_no_run_is_told_after_the_patience(session: zenoh.Session) -> None:
    with pytest.raises(InputError, match=r"^the hub serves no run: start `python -m learner`"):
        find_run(session, None, 0.0, never)


def test_a_run_that_is_not_there_is_told_by_name(
    hub: zenoh.Session, session: zenoh.Session
) -> None:
    announce(hub, "one", encode_announcement("one", FAST))
    with pytest.raises(InputError, match=r"^the hub serves no run called 'other'"):
        find_run(session, "other", 0.0, never)


def test_a_run_that_starts_later_is_waited_for(hub: zenoh.Session, session: zenoh.Session) -> None:
    asked = 0

    def begins_after_two_looks() -> bool:
        nonlocal asked
        asked += 1
        if asked == 2:
            announce(hub, "late", encode_announcement("late", FAST))
        return False

    assert find_run(session, None, PATIENCE, begins_after_two_looks)[0] == RunKeys("late")
    assert asked >= 2


def test_whoever_wants_to_stop_need_not_wait(session: zenoh.Session) -> None:
    with pytest.raises(KeyboardInterrupt):
        find_run(session, None, 1e9, lambda: True)


def test_a_hub_of_another_version_is_told(hub: zenoh.Session, session: zenoh.Session) -> None:
    good = encode_announcement("one", FAST)
    for answer in (
        b"",
        b"garbage",
        pack({"run": "one"}),
        pack({"run": "one", "config": b"{"}),
        pack({"run": 1, "config": to_json(FAST).encode()}),
        good.replace(b"schema" + bytes([SCHEMA]), b"schema\x63"),
    ):
        assert answer != good
        queryable = announce(hub, "one", answer)
        with pytest.raises(InputError, match="install the same version on both machines"):
            find_run(session, None, PATIENCE, never)
        queryable.undeclare()  # type: ignore[no-untyped-call]


def test_what_is_announced_is_checked() -> None:
    with pytest.raises(InputError, match="'a/b' cannot be used"):
        decode_announcement(encode_announcement("a/b", FAST))
    with pytest.raises(InputError, match="the hub's configuration has a missing or unknown field"):
        decode_announcement(pack({"run": "one", "config": b"{}"}))
    hopeless = replace(FAST, replay=replace(FAST.replay, capacity=1))
    with pytest.raises(InputError, match=r"replay\.capacity is 1"):
        decode_announcement(encode_announcement("one", hopeless))
    with pytest.raises(MessageError, match="no JSON"):
        decode_announcement(pack({"run": "one", "config": b"\xff"}))


def test_a_configuration_nested_without_end_is_refused() -> None:
    with pytest.raises(MessageError):
        decode_announcement(pack({"run": "one", "config": b"[" * 200_000}))


def test_a_name_that_is_no_key_is_told(session: zenoh.Session) -> None:
    with pytest.raises(InputError, match="'a//b' cannot be used"):
        find_run(session, "a//b", 0.0, never)
