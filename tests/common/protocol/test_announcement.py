"""The announcement of a run: whole, and checked."""

from dataclasses import replace

import pytest

from common.errors import InputError, MessageError
from common.protocol.announcement import decode_announcement, encode_announcement
from common.protocol.wire import pack
from common.run.config import to_json
from common.run.presets import PRESETS

FAST, PAPER = PRESETS["fast"], PRESETS["paper"]


@pytest.mark.parametrize("name", list(PRESETS))
def test_a_configuration_is_announced_whole(name: str) -> None:
    config = PRESETS[name]  # type: ignore[index]
    assert decode_announcement(encode_announcement("run-1", config)) == ("run-1", config)


def test_what_is_announced_is_checked() -> None:
    with pytest.raises(InputError, match="'a/b' cannot be used"):
        decode_announcement(encode_announcement("a/b", FAST))
    with pytest.raises(InputError, match="the hub's configuration has a missing or unknown field"):
        decode_announcement(pack({"run": "one", "config": b"{}", "actions": 6}))
    hopeless = replace(FAST, replay=replace(FAST.replay, capacity=1))
    with pytest.raises(InputError, match=r"replay\.capacity is 1"):
        decode_announcement(encode_announcement("one", hopeless))
    with pytest.raises(MessageError, match="no JSON"):
        decode_announcement(pack({"run": "one", "config": b"\xff", "actions": 6}))


def test_a_configuration_nested_without_end_is_refused() -> None:
    with pytest.raises(MessageError):
        decode_announcement(pack({"run": "one", "config": b"[" * 200_000, "actions": 6}))


@pytest.mark.parametrize("actions", [5, 18])
def test_machines_that_disagree_on_the_actions_do_not_play_together(actions: int) -> None:
    payload = pack({"run": "one", "config": to_json(FAST).encode(), "actions": actions})
    with pytest.raises(InputError, match=rf"pong \(ale\) has {actions} actions at the hub and 6"):
        decode_announcement(payload)


@pytest.mark.parametrize("actions", [0, 257])
def test_a_number_of_actions_that_no_chunk_could_carry_is_malformed(actions: int) -> None:
    with pytest.raises(MessageError):
        decode_announcement(pack({"run": "one", "config": b"{}", "actions": actions}))
