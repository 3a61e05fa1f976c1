"""`Broadcast`: sends the learned weights to all actors, signed, and often enough."""

from collections.abc import Callable
from dataclasses import dataclass

from common.protocol.weights import encode_weights
from common.protocol.wire import encode_version
from common.schedule import Every, Now
from common.transport.signature import Sign
from learner.algorithm.interface import Algorithm

_PERIOD = 10.0
"""Seconds after which weights are sent again: a restarted replay has none to hand out."""


@dataclass
class Broadcast:
    """Sends weights; their version is the number of updates that made them."""

    algorithm: Algorithm
    run_id: str
    publish: Callable[[bytes, bytes], None]
    """Takes the weights, and their version, run and signature."""
    sign: Sign
    now: Now

    def __post_init__(self) -> None:
        self.version = 0
        """Version of the weights that were sent last."""
        self._schedule = Every(_PERIOD, self.now)

    def is_due(self) -> bool:
        """Whether the last weights were sent long ago."""
        return self._schedule.is_due()

    def send(self, updates: int) -> None:
        """Sends the present weights, which ``updates`` updates have made."""
        weights = encode_weights(self.algorithm.published)
        signature = self.sign("training", updates, self.run_id, weights)
        self.publish(weights, encode_version(updates, self.run_id, signature))
        self.version = updates
        self._schedule.restart()
