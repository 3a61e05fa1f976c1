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

from actors.envs.hand_timing import HandLatency, key_latencies
from actors.robots.interface import Hands
from common.actions import OPPOSITES, Keys
from common.run.conditions import MAX_ADDED, MAX_GAP

_HANDS = tuple(map(int, (Keys.UP | Keys.DOWN | Keys.LEFT | Keys.RIGHT, Keys.FIRE)))
"""The keys of each hand, or stick. It moves from one set of its keys to another."""
_OPPOSITES = tuple(map(int, OPPOSITES))
GAP = 1
"""Emulator frames by which a hand presses its keys later than it releases others."""
TRAVEL = 1
"""Further frames for a hand that released keys less than `REST` frames ago: it is still moving."""
REST = 6
"""Emulator frames without a key after which a hand is at rest."""
_REMEMBERED = MAX_ADDED + max(GAP + TRAVEL, MAX_GAP) + REST + 1


class LatencyEqualiser:
    """Implements `Hands` by others: each hand leaves its keys ``latency`` emulator frames after
    what was seen when that was commanded, and presses others ``gap`` frames later than that; if it
    is 0 `GAP`, or `GAP` + `TRAVEL`, as NAO's do. Keys that are not commanded for so long are not
    pressed.

    Hands that need longer are not made slower. Until they are timed they count as without latency.
    It runs in every frame, hence whole numbers instead of `Keys`.
    """

    def __init__(
        self,
        hands: Hands,
        latency: int,
        gap: int = 0,
        give: Callable[[int], None] = lambda ago: None,
    ) -> None:
        """``give`` is told, before each command that the hands get, how many emulator frames ago
        the agent gave it."""
        self._hands = hands
        self._latency = latency
        self._gap, self._travel = (gap, 0) if gap else (GAP, TRAVEL)
        self._give = give
        self.seen_late = 0
        """Emulator frames by which the eye's pictures are late."""
        self._keys_by_latency: dict[HandLatency, int] = {HandLatency(0, 0, 0): ~0}
        """The quickest first."""
        self._passed_on: int
        """What the hands were told last."""
        self._forget()

    def time(self, keys: Keys) -> None:
        """Finds out how long the hands take to release and to press each of ``keys``; lets them
        rest afterwards."""
        keys_by_latency: dict[HandLatency, int] = {}
        for key, (release, *presses) in key_latencies(self._hands, keys, self._give).items():
            # A command that pressed a key sooner than it releases another would take two.
            gaps = zip(presses, (self._gap, self._gap + self._travel), strict=True)
            latency = HandLatency(release, *(min(press, release + gap) for press, gap in gaps))
            keys_by_latency[latency] = keys_by_latency.get(latency, 0) | int(key)
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
        self._schedule.append(self._held())
        if (due := self._due()) != self._passed_on:
            self._give(self._given_ago(due))
            self._passed_on = due
            self._hands.command(Keys(due))
        return self._hands.step_frame()

    def _due(self) -> int:
        """The keys that the hands have to set out for now, to hold the right ones in time."""
        due = 0
        for (release, press, in_play), keys in self._keys_by_latency.items():
            coming = [
                self._held_in(frames)
                for frames in range(min(release, press), max(release, press) + 1)
            ]
            moving = [self._pressed_in_play(frames) for frames in range(press + 1, in_play + 1)]
            keys &= reduce(or_, moving, reduce(or_ if press > release else and_, coming))
            for pair in _OPPOSITES:
                if due & pair:  # a quicker key opposite is to be held sooner
                    keys &= ~pair
                elif keys & pair == pair:  # the hand stays where it is until it may leave
                    keys &= ~pair | self._passed_on
            due |= keys
        return due

    def _pressed_in_play(self, frames: int) -> int:
        """The keys that are to be pressed so many frames from now, by a hand that still moves."""
        pressed = self._held_in(frames) & ~self._held_in(frames - 1)
        if self._travel:  # it was commanded gap and travel before; at rest, the gap
            return pressed & self._seen_in(frames - self._gap - self._travel)
        before = reduce(or_, (self._held_in(frames - ago) for ago in range(1, REST + 1)))
        return reduce(or_, (pressed & hand for hand in _HANDS if before & hand), 0)

    def _given_ago(self, due: int) -> int:
        """How many emulator frames ago the agent gave the command by which ``due`` is due."""
        pressed = due & ~self._passed_on
        changed = pressed or self._passed_on & ~due
        lead = self._latency - self.seen_late
        own = [
            latency.press if pressed else latency.release
            for latency, keys in self._keys_by_latency.items()
            if keys & changed
        ]
        ago, last = max(0, lead - min(own)), len(self._told) - 1
        hands = sum(hand for hand in _HANDS if hand & changed)
        wanted = self._told[last - ago] & hands
        while ago < last and self._told[last - ago - 1] & hands == wanted:
            ago += 1
        return ago

    def _held_in(self, frames: int) -> int:
        """The keys that are to be held so many frames from now."""
        ahead = frames - (self._latency - self.seen_late)
        return self._held(ahead) if ahead > 0 else self._schedule[ahead - 1]

    def _held(self, ahead: int = 0) -> int:
        """The keys that are to be held by the last command, if it has lasted ``ahead`` frames
        more."""
        last = len(self._told) - 1
        remembered = range(self._gap + self._travel + REST)
        past = [self._told[min(last, last + ahead - ago)] for ago in remembered]
        held = 0
        for hand in _HANDS:
            keys, *before = (each & hand for each in past)
            moving = any(before[self._gap :])
            if all(each == keys for each in before[: self._gap + self._travel * moving]):
                held |= keys
        return held

    def _seen_in(self, frames: int) -> int:
        """The keys that were commanded for what is to be seen so many frames from now."""
        last = len(self._told) - 1
        return self._told[min(last, last + frames - (self._latency - self.seen_late))]

    def _forget(self) -> None:
        self._wanted = self._passed_on = 0
        self._told: deque[int] = deque([0] * _REMEMBERED, maxlen=_REMEMBERED)
        """What was commanded in each of the last frames."""
        self._schedule: deque[int] = deque(self._told, maxlen=_REMEMBERED)
        """For each of them, the keys that are to be held when its time has come."""
