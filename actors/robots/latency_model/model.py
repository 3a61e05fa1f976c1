"""Hands modelled by a small network, which maps the last commands to what the console gets."""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from actors.robots.latency_model.weights import ACTIONS, COMMANDS, ROW, ModelWeights, read_copies
from common.actions import KEYS_OF_ACTION, Keys, action_of_keys
from common.settings.conditions import FRAMES_PER_SECOND, LatencyModelSettings, PlayConfig
from common.settings.own_settings import own_settings

_NOTHING = (0, ACTIONS)


class _Layers(NamedTuple):
    """The weights of one copy, arranged for one-hot inputs."""

    columns: NDArray[np.float64]
    """``[30, 36, H]``: to multiply by a one-hot vector is to select one of 36."""
    bias: NDArray[np.float64]
    """``[H]``."""
    pred_weight: NDArray[np.float64]
    """``[18, H]``."""
    pred_bias: NDArray[np.float64]
    """``[18]``."""

    @classmethod
    def of(cls, weights: ModelWeights) -> Self:
        columns = np.ascontiguousarray(weights.fc_weight.T).reshape(COMMANDS, ROW, -1)
        return cls(columns, weights.fc_bias, weights.pred_weight, weights.pred_bias)


class LatencyModel:
    """Implements `Hands`: keys that follow the commands as a small network says.

    The network runs ``rate`` times a second. Its input is the present command and the last 29, each
    with the action that the console got just before: the command one-hot, then that action one-hot.
    Two dense layers with a ReLU between them give 18 numbers, and the action of the greatest is
    held until the next run. Nothing is random. A game begins with no commands and no keys pressed.

    Of several copies of the same hands one holds the keys, the first until `take_copy`.
    """

    def __init__(self, copies: Sequence[ModelWeights], rate: int) -> None:
        self._copies = [_Layers.of(each) for each in copies]
        self._layers = self._copies[0]
        self._period = FRAMES_PER_SECOND // rate
        self._slots = np.arange(COMMANDS)[:, None]
        self.rest()

    @classmethod
    def of_play(cls, play: PlayConfig) -> Self:
        """Returns the model in the file ``play.robot``; see `read_copies`."""
        settings = own_settings(LatencyModelSettings, play.robot_settings)
        return cls(read_copies(play.robot), settings.rate)

    @property
    def held(self) -> Keys:
        return KEYS_OF_ACTION[self._taken]

    def take_copy(self, number: int) -> None:
        """Takes the copy of this number, modulo their number."""
        self._layers = self._copies[number % len(self._copies)]

    def rest(self) -> None:
        self._past = deque([_NOTHING] * COMMANDS, maxlen=COMMANDS)
        self._wanted = self._taken = self._frame = 0

    def command(self, keys: Keys) -> None:
        self._wanted = action_of_keys(keys)

    def step_frame(self) -> Keys:
        if self._frame % self._period == 0:
            self._past.append((self._wanted, ACTIONS + self._taken))
            self._taken = self._next()
        self._frame += 1
        return self.held

    def _next(self) -> int:
        layers = self._layers
        hidden = layers.columns[self._slots, np.array(self._past)].sum(axis=(0, 1)) + layers.bias
        values = layers.pred_weight @ np.maximum(hidden, 0.0) + layers.pred_bias
        return int(values.argmax())
