"""Plans commands ahead with a model of the hands, so that they hold the right keys in each frame.

Hands may need longer for one change of keys than for another, and how long may depend on all that
they were told before. Whoever has a model of them can try commands on it first. In each frame the
plan simulates what the hands would hold after each of many sequences of commands, and gives the
first command of the best one (model predictive control).
"""

from collections.abc import Sequence
from functools import cache
from itertools import combinations_with_replacement, product
from typing import Self

import numpy as np
from numpy.typing import NDArray

from actors.envs.hand_timing import HandLatency, key_latencies
from actors.envs.key_forecast import LONGEST
from actors.robots.latency_model.model import LatencyModel
from actors.robots.latency_model.weights import (
    ACTIONS,
    COMMANDS,
    ROW,
    ModelWeights,
    check_one_copy,
    read_weights,
)
from common.actions import Keys
from common.errors import InputError
from common.settings.conditions import FRAMES_PER_SECOND, PlayConfig

_OPEN = 6
"""Commands of a sequence, one for each frame; its last one lasts."""
_CHOICES = 3
"""Maximum number of different commands in the sequences that are compared."""
_ASSUMED = 0.25
"""Weight of a frame whose keys are not sure yet, because later commands may change them."""
_LATER = 0.99
"""Weight of a frame beside that of the frame before it: what comes later can still be changed."""
_CHANGE = 0.01
"""Price of a change of the command, in frames with other keys: of equal sequences, the calmest."""

_QUICKER = 3
"""Frames by which hands may press a key sooner than their model: arms differ in speed."""

Actions = NDArray[np.int64]


class CommandPlan:
    """Chooses what to tell the hands in each emulator frame; `feel` takes what they hold then.

    Actions are ALE's 18.
    """

    def __init__(self, weights: ModelWeights) -> None:
        timed = key_latencies(LatencyModel([weights], FRAMES_PER_SECOND), ~Keys.NONE)
        # A model may know nothing of keys that were never commanded where it was learned.
        self._own = {key: latency for key, latency in timed.items() if max(latency) < LONGEST}
        self._soonest = min(map(min, self._own.values()), default=0)
        self._horizon = min(max(map(max, self._own.values()), default=0) + _OPEN, COMMANDS)
        columns = weights.fc_weight.astype(np.float32).T.reshape(COMMANDS, ROW, -1)
        self._of_command = np.ascontiguousarray(columns[:, :ACTIONS])
        """What the command of each of 30 frames adds to the hidden units, ``[30, 18, H]``."""
        self._of_held = np.ascontiguousarray(columns[:, ACTIONS:])
        """The same of what was held just before that command."""
        self._of_lasting = np.cumsum(self._of_command[::-1], axis=0)[::-1].copy()
        """The same of a command that lasts from that frame to the last one."""
        self._bias = weights.fc_bias.astype(np.float32)
        self._values = np.ascontiguousarray(weights.pred_weight.T, np.float32)
        self._value_bias = weights.pred_bias.astype(np.float32)
        self._late = 0
        """Frames after which a command reaches the hands."""
        self.rest()

    @classmethod
    def of_play(cls, play: PlayConfig) -> Self | None:
        """Returns the plan by the model in the file ``play.hands_model``, or None without one.
        Raises InputError as `read_weights` does, for the file of the hands themselves too."""
        if not play.hands_model:
            return None
        check_one_copy(play)  # of several, some may be quicker than the plan's
        return cls(read_weights(play.hands_model))

    @property
    def frames(self) -> int:
        """Number of coming frames whose keys have to be known, the present one included."""
        return self._late + self._horizon

    def rest(self) -> None:
        """Forgets everything: the hands are at rest, and no command is on its way."""
        self._given = np.zeros(COMMANDS - 1 + self._late, np.int64)
        """The last commands, oldest first; the last of them are on their way."""
        self._held = np.zeros(COMMANDS, np.int64)
        """What was held at the end of each of the last frames."""
        self._sequence = np.zeros(_OPEN, np.int64)
        """The commands of the present frame and the next ones."""
        self._foreseen = np.zeros(0, np.int64)
        """What the hands will hold after them at the end of each of these frames."""

    def time(self, latencies: dict[Keys, HandLatency]) -> None:
        """Takes how long the hands need, by key. What the model does not need is the commands' way
        to them, by the quickest key, because commands may jitter.

        Raises:
            InputError: the hands are much quicker than their model.
        """
        extra = [
            latencies[key].press - own.press for key, own in self._own.items() if key in latencies
        ]
        quickest = min(extra, default=0)
        if quickest < -_QUICKER:
            raise InputError(
                f"the hands press a key {-quickest} frames sooner than by play.hands_model: name "
                "the file of a model of these hands."
            )
        self._late = max(0, quickest)
        self.rest()

    def command(self, wanted: Sequence[int], sure: int) -> int:
        """Returns the action to command now.

        Args:
            wanted: what is to be held at the end of each of the next `frames`.
            sure: number of those that no later command can change.
        """
        goal = np.array(wanted)
        choices, which = np.unique(self._sequence, return_inverse=True)
        self._foreseen = self._simulate(choices, which[None], self._foreseen[None])[0]
        if (self._foreseen != goal).any():
            frame = np.arange(len(goal))
            self._improve(goal, np.where(frame < sure, 1.0, _ASSUMED) * _LATER**frame)
        command = int(self._sequence[0])
        self._given = np.append(self._given[1:], command)
        self._sequence = np.append(self._sequence[1:], self._sequence[-1])
        return command

    def feel(self, held: int) -> None:
        """Takes what the hands hold at the end of the frame."""
        self._held = np.append(self._held[1:], held)
        surprised = self._foreseen[0] != held
        self._foreseen = self._foreseen[len(self._foreseen) if surprised else 1 :]

    def _improve(self, goal: Actions, weights: NDArray[np.float64]) -> None:
        """Takes another sequence if it holds the goal in more frames, each with its weight."""
        before = self._given[-1]
        reached = goal[min(self._late + self._soonest, len(goal) - 1) :]
        choices = np.array(list(dict.fromkeys([before, *reached]))[:_CHOICES])
        which = _sequences(len(choices))
        held = self._simulate(choices, which, np.empty((len(which), 0), np.int64))
        sequences = np.append(self._sequence[None], choices[which], axis=0)
        held = np.append(self._foreseen[None], held, axis=0)
        changes = (np.diff(sequences, axis=1, prepend=before) != 0).sum(axis=1)
        best = int(((held != goal) @ weights + _CHANGE * changes).argmin())
        self._sequence, self._foreseen = sequences[best], held[best]

    def _simulate(self, choices: Actions, which: Actions, known: Actions) -> Actions:
        """Returns what is held at the end of each of the next `frames`, ``[N, frames]``.

        Args:
            choices: the commands of which the sequences consist.
            which: their places in ``choices``, for each of ``N`` sequences, ``[N, _OPEN]``.
            known: what is held in the first of the frames, ``[N, any]``.
        """
        held = np.empty((len(which), self.frames), np.int64)
        held[:, : known.shape[1]] = known
        one_hot = np.eye(len(choices), dtype=np.float32)[which]
        # Most sequences lead to the same keys at first, which then count alike.
        group, one_of_each = np.zeros(len(which), np.int64), np.zeros(1, np.int64)
        for frame in range(known.shape[1], self.frames):
            given, before = self._given[frame:][:COMMANDS], self._held[frame:]
            fixed = self._bias + self._of_command[np.arange(len(given)), given].sum(axis=0)
            fixed += self._of_held[np.arange(len(before)), before].sum(axis=0)
            since = held[one_of_each, :frame][:, -COMMANDS:]
            hidden = fixed + self._of_held[np.arange(len(before), COMMANDS), since].sum(axis=1)
            hidden = hidden[group]
            first = COMMANDS - 1 + self._late - frame  # place of the sequences' first command
            places = np.arange(first, min(first + _OPEN, COMMANDS))
            if places.size:
                of_choice = self._of_command[places[:, None], choices]
                if places.size == _OPEN:
                    of_choice[-1] = self._of_lasting[places[-1], choices]
                chosen = one_hot[:, : places.size].reshape(len(which), -1)
                hidden += chosen @ of_choice.reshape(chosen.shape[1], -1)
            values = np.maximum(hidden, 0) @ self._values + self._value_bias
            held[:, frame] = values.argmax(axis=1)
            _, one_of_each, group = np.unique(
                group * ACTIONS + held[:, frame], return_index=True, return_inverse=True
            )
        return held


@cache
def _sequences(choices: int) -> Actions:
    """Returns all sequences of so many choices that change at most twice, ``[N, _OPEN]``."""
    cuts = combinations_with_replacement(range(_OPEN + 1), 2)
    found = {
        (a,) * i + (b,) * (j - i) + (c,) * (_OPEN - j)
        for (i, j), (a, b, c) in product(cuts, product(range(choices), repeat=3))
    }
    return np.array(sorted(found))
