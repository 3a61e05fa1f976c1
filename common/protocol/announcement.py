"""How a hub tells those who join which run it serves, and under which configuration."""

import json
from dataclasses import dataclass

from common.errors import MessageError
from common.protocol.message import Message
from common.protocol.run_keys import check_name
from common.run.config import RunConfig, from_mapping, to_json


@dataclass(frozen=True)
class Announcement(Message):
    """A run and its configuration, as JSON."""

    run: str
    config: bytes


def encode_announcement(run: str, config: RunConfig) -> bytes:
    return Announcement(run, to_json(config).encode()).encode()


def decode_announcement(payload: bytes) -> tuple[str, RunConfig]:
    """Returns name and configuration of the run.

    Raises:
        MessageError: a malformed message.
        InputError: a configuration that this version does not know.
    """
    told = Announcement.decode(payload)
    try:
        mapping = json.loads(told.config)
    except (ValueError, RecursionError):
        raise MessageError("the configuration is no JSON") from None
    config = from_mapping(RunConfig, mapping, "the hub's configuration")
    config.check()
    return check_name("run", told.run), config
