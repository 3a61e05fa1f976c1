"""The announcement of a run: whole, and checked."""

from dataclasses import replace
from typing import Any

import pytest

from common.errors import InputError, MessageError
from common.protocol.wire import pack
from common.run.announcement import Announcement
from common.settings.presets import PRESETS

FAST = PRESETS["fast"]
GOOD = Announcement("one", FAST, 6, "id")


@pytest.mark.parametrize("name", list(PRESETS))
def test_a_configuration_is_announced_whole(name: str) -> None:
    config = PRESETS[name]  # type: ignore[index]
    told = Announcement("run-1", config, 6, "id")
    assert Announcement.decode(told.encode()) == told


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"config": replace(FAST, replay=replace(FAST.replay, capacity=1))}, "capacity is 1"),
        ({"actions": 5}, r"pong \(ale\) has 5 actions at the hub and 6 here"),
        ({"actions": 18}, r"pong \(ale\) has 18 actions at the hub and 6 here"),
    ],
)
def test_a_run_that_cannot_be_played_here_is_told(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        Announcement.decode(replace(GOOD, **changes).encode())


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"run": "a/b"}, "run is 'a/b', which is not a name"),
        ({"config": {}}, "config has a missing or unknown field"),
        ({"config": b"\xff"}, "config should be a table of settings"),
        ({"config": {**vars(FAST), "play": {"frame_stack": 4}}}, r"config\.play has a missing"),
        ({"config": {**vars(FAST), "seed": -1}}, r"config\.seed is -1"),
        ({"actions": 0}, "actions is 0"),
        ({"actions": 257}, "actions is 257"),  # no chunk could carry them
    ],
)
def test_another_announcement_is_malformed(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(MessageError, match=sentence):
        Announcement.decode(pack(vars(GOOD) | changes))


def test_a_configuration_nested_without_end_is_refused() -> None:
    payload = pack(vars(GOOD) | {"config": None})
    deep = payload.replace(b"\xa6config\xc0", b"\xa6config" + b"\x91" * 200_000)
    assert len(deep) > 200_000
    with pytest.raises(MessageError):
        Announcement.decode(deep)
