"""How a hub tells those who join which run it serves, and under which configuration."""

import json
from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from common.errors import InputError, MessageError
from common.protocol.message import Message
from common.protocol.run_keys import check_name
from common.run.config import RunConfig, from_mapping, to_json


@dataclass(frozen=True)
class Announcement(Message):
    """A run, its configuration as JSON, and the number of actions that its replay admits."""

    run: str
    config: bytes
    actions: Annotated[int, Ge(1), Le(256)]


def encode_announcement(run: str, config: RunConfig) -> bytes:
    """Returns the payload. Raises InputError for an environment or game that there is not."""
    return Announcement(run, to_json(config).encode(), config.action_count).encode()


def decode_announcement(payload: bytes) -> tuple[str, RunConfig]:
    """Returns name and configuration of the run.

    Raises:
        MessageError: a malformed message.
        InputError: a configuration that this version does not know, or an environment that has
            another number of actions here.
    """
    told = Announcement.decode(payload)
    try:
        mapping = json.loads(told.config)
    except (ValueError, RecursionError):
        raise MessageError("the configuration is no JSON") from None
    config = from_mapping(RunConfig, mapping, "the hub's configuration")
    config.check()
    if told.actions != config.action_count:
        raise InputError(
            f"{config.game} ({config.env}) has {told.actions} actions at the hub and "
            f"{config.action_count} here: install the same versions on both machines."
        )
    return check_name("run", told.run), config
