"""When hands of one latency are to hold which keys."""

from collections import deque
from functools import reduce
from operator import or_

from common.actions import Keys
from common.settings.conditions import MAX_ADDED, MAX_GAP

_HANDS = tuple(map(int, (Keys.UP | Keys.DOWN | Keys.LEFT | Keys.RIGHT, Keys.FIRE)))
"""The keys of each hand, or stick. It moves from one set of its keys to another."""
GAP = 1
"""Emulator frames by which a hand presses its keys later than it releases others."""
TRAVEL = 1
"""Further frames for a hand that released keys less than `REST` frames ago: it is still moving."""
REST = 6
"""Emulator frames without a key after which a hand is at rest."""
_REMEMBERED = MAX_ADDED + max(GAP + TRAVEL, MAX_GAP) + REST + 1


class KeySchedule:
    """Each hand leaves its keys ``latency`` emulator frames after what was seen when that was
    commanded, and presses others ``gap`` frames later than that; if it is 0 `GAP`, or `GAP` +
    `TRAVEL`, as NAO's do. Keys that are not commanded for so long are not pressed.

    It runs in every frame and therefore uses whole numbers instead of `Keys`.
    """

    def __init__(self, latency: int, gap: int = 0) -> None:
        self._latency = latency
        self.gap, self.travel = (gap, 0) if gap else (GAP, TRAVEL)
        self.seen_late = 0
        """Emulator frames by which the eye's pictures are late."""
        self.forget()

    def forget(self) -> None:
        """Forgets all commands: a game begins."""
        self._told: deque[int] = deque([0] * _REMEMBERED, maxlen=_REMEMBERED)
        """What was commanded in each of the last frames."""
        self._schedule: deque[int] = deque(self._told, maxlen=_REMEMBERED)
        """For each of them, the keys that are to be held when its time has come."""

    def command(self, keys: int) -> None:
        """Notes what is commanded in one more frame. It is now."""
        self._told.append(keys)
        self._schedule.append(self._held())

    @property
    def lead(self) -> int:
        """Emulator frames from a command until it is to be obeyed."""
        return self._latency - self.seen_late

    def held_in(self, frames: int) -> int:
        """Returns the keys that are to be held so many frames from now; beyond `lead`, if the last
        command lasts."""
        ahead = frames - self.lead
        return self._held(ahead) if ahead > 0 else self._schedule[ahead - 1]

    def pressed_in_play(self, frames: int) -> int:
        """Returns the keys that are to be pressed so many frames from now, by a hand that still
        moves."""
        pressed = self.held_in(frames) & ~self.held_in(frames - 1)
        if self.travel:  # it was commanded gap and travel before; at rest, the gap
            last = len(self._told) - 1
            ahead = frames - self.gap - self.travel - self.lead
            return pressed & self._told[min(last, last + ahead)]
        before = reduce(or_, (self.held_in(frames - ago) for ago in range(1, REST + 1)))
        return reduce(or_, (pressed & hand for hand in _HANDS if before & hand), 0)

    def given_ago(self, changed: int, frames: int) -> int:
        """Returns how many frames ago that command was given which changes the keys ``changed`` so
        many frames from now: the first of those that want the same of their hands."""
        ago, last = max(0, self.lead - frames), len(self._told) - 1
        hands = sum(hand for hand in _HANDS if hand & changed)
        wanted = self._told[last - ago] & hands
        while ago < last and self._told[last - ago - 1] & hands == wanted:
            ago += 1
        return ago

    def _held(self, ahead: int = 0) -> int:
        """The keys that are to be held by the last command, if it has lasted ``ahead`` frames
        more."""
        last = len(self._told) - 1
        remembered = range(self.gap + self.travel + REST)
        past = [self._told[min(last, last + ahead - ago)] for ago in remembered]
        held = 0
        for hand in _HANDS:
            keys, *before = (each & hand for each in past)
            moving = any(before[self.gap :])
            if all(each == keys for each in before[: self.gap + self.travel * moving]):
                held |= keys
        return held
