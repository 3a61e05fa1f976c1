"""One latency for all hands: quick ones get their commands later.

A policy plays well at the latency that it learned with, and an emulator frame more or less costs it
the game. What cannot be made quicker can be waited for: each key is released and pressed as late as
by the slowest hands that are expected. A receiver of speech does the same with packets that come
after different times (a playout buffer).
"""

from collections import deque
from collections.abc import Callable
from functools import reduce
from operator import and_, or_

from actors.envs.hand_timing import key_latencies
from actors.robots.interface import Hands
from common.actions import OPPOSITES, Keys
from common.run.conditions import MAX_ADDED

GAP = 1
"""Emulator frames by which a key is pressed later than another one is released: a hand on its way
from key to key holds neither. NAO's needs one more."""
_REMEMBERED = MAX_ADDED + GAP + 1


class LatencyEqualiser:
    """Implements `Hands` by others: a key is released ``latency`` emulator frames after what was
    seen when that was commanded, and pressed ``GAP`` frames later than that. A key that is
    commanded for ``GAP`` frames or less is not pressed.

    Hands that need longer are not made slower. Until they are timed they count as without latency.
    It runs in every frame, hence whole numbers instead of `Keys`.
    """

    def __init__(
        self, hands: Hands, latency: int, give: Callable[[int], None] = lambda ago: None
    ) -> None:
        """Args:
        give: is told, before each command that the hands get, how many emulator frames ago the
            agent gave it.
        """
        self._hands = hands
        self._latency = latency
        self._give = give
        self.seen_late = 0
        """Emulator frames by which the eye's pictures are late."""
        self._keys_by_latency: dict[tuple[int, int], int] = {(0, 0): ~0}
        """The quickest first."""
        self._passed_on: int
        """What the hands were told last."""
        self._forget()

    def time(self, keys: Keys) -> None:
        """Find out how long the hands take to release and to press each of ``keys``; let them rest
        afterwards."""
        keys_by_latency: dict[tuple[int, int], int] = {}
        for key, (release, press) in key_latencies(self._hands, keys, self._give).items():
            # A command that pressed a key sooner than it releases another would take two.
            latency = release, min(press, release + GAP)
            keys_by_latency[latency] = keys_by_latency.get(latency, 0) | key
        self._keys_by_latency = dict(sorted(keys_by_latency.items()))

    @property
    def held(self) -> Keys:
        return self._hands.held

    def rest(self) -> None:
        self._hands.rest()
        self._forget()

    def command(self, keys: Keys) -> None:
        self._wanted = int(keys)

    def step_frame(self) -> Keys:
        self._told.append(self._wanted)
        if (due := self._due()) != self._passed_on:
            self._give(self._given_ago(due))
            self._passed_on = due
            self._hands.command(Keys(due))
        return self._hands.step_frame()

    def _due(self) -> int:
        """The keys that the hands have to set out for now, to hold the right ones in time."""
        due = 0
        for (release, press), keys in self._keys_by_latency.items():
            coming = [
                self._held_in(frames)
                for frames in range(min(release, press), max(release, press) + 1)
            ]
            keys &= reduce(or_ if press > release else and_, coming)
            for pair in OPPOSITES:
                if due & pair:  # a quicker key opposite is to be held sooner
                    keys &= ~pair
            due |= keys
        return due

    def _given_ago(self, due: int) -> int:
        """How many emulator frames ago the agent gave the command by which ``due`` is due."""
        pressed = due & ~self._passed_on
        changed = pressed or self._passed_on & ~due
        lead = self._latency - self.seen_late
        own = [
            latency[bool(pressed)]
            for latency, keys in self._keys_by_latency.items()
            if keys & changed
        ]
        ago, last = max(0, lead - min(own)), len(self._told) - 1
        while ago < last and self._told[last - ago - 1] & changed == pressed:
            ago += 1
        return ago

    def _held_in(self, frames: int) -> int:
        """The keys that are to be held so many frames from now."""
        last = len(self._told) - 1
        seen = last + frames - (self._latency - self.seen_late)
        return reduce(and_, (self._told[min(each, last)] for each in range(seen - GAP, seen + 1)))

    def _forget(self) -> None:
        self._wanted = self._passed_on = 0
        self._told: deque[int] = deque([0] * _REMEMBERED, maxlen=_REMEMBERED)
        """What was commanded in each of the last frames."""
