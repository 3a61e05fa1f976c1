"""Talking to a replay server."""

from common.protocol.ack import Ack
from common.protocol.chunk import Chunk
from common.protocol.run_keys import RunKeys
from common.transport.interface import Transport
from tests.patience import PATIENCE
from tests.replay.replay_reference import RUN

KEYS = RunKeys(RUN, RUN)


def ask(transport: Transport, key: str, payload: bytes) -> bytes:
    """The answer.

    Raises:
        MessageError: the server refused.
    """
    return transport.requester(key, PATIENCE).request(payload).result().payload


def insert(transport: Transport, chunk: Chunk) -> Ack:
    return Ack.decode(ask(transport, KEYS.insert(chunk.actor), chunk.encode()))
