"""One latency for all hands: quick ones get their commands later.

A policy plays well at the latency that it learned with, and an emulator frame more or less costs it
the game. What cannot be made quicker can be waited for: each key is released and pressed as late as
by the slowest hands that are expected. A receiver of speech does the same with packets that come
after different times (a playout buffer).
"""

from collections.abc import Callable
from functools import reduce
from operator import and_, or_

from actors.envs.command_plan import CommandPlan
from actors.envs.hand_timing import HandLatency, key_latencies
from actors.envs.key_schedule import KeySchedule
from actors.robots.interface import Hands
from common.actions import KEYS_OF_ACTION, OPPOSITES, Keys, action_of_keys

_OPPOSITES = tuple(map(int, OPPOSITES))


class LatencyEqualiser:
    """Implements `Hands` by others, which get their commands so that they keep a `KeySchedule`.

    Each key is timed before a game, and then commanded as soon as its latency asks for. With a
    ``plan``, a model of the hands says what to command.

    Hands that need longer are not made slower. Until they are timed they count as without latency.
    """

    def __init__(
        self,
        hands: Hands,
        latency: int,
        gap: int = 0,
        give: Callable[[int], None] = lambda ago: None,
        plan: CommandPlan | None = None,
    ) -> None:
        """``give`` is told, before each command that the hands get, how many emulator frames ago
        the agent gave it."""
        self._hands = hands
        self._give = give
        self._plan = plan
        self._schedule = KeySchedule(latency, gap)
        self._keys_by_latency: dict[HandLatency, int] = {HandLatency(0, 0, 0): ~0}
        """The quickest first."""
        self._told: int
        """What the hands were told last."""
        self._forget()

    @property
    def seen_late(self) -> int:
        """Emulator frames by which the eye's pictures are late."""
        return self._schedule.seen_late

    @seen_late.setter
    def seen_late(self, frames: int) -> None:
        self._schedule.seen_late = frames

    def time(self, keys: Keys) -> None:
        """Finds out how long the hands take to release and to press each of ``keys``, which leaves
        them anywhere."""
        latencies = key_latencies(self._hands, keys, self._give)
        if self._plan is not None:
            self._plan.time(latencies)
        keys_by_latency: dict[HandLatency, int] = {}
        for key, (release, *presses) in latencies.items():
            # A command that pressed a key sooner than it releases another would take two.
            gap, travel = self._schedule.gap, self._schedule.travel
            gaps = zip(presses, (gap, gap + travel), strict=True)
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
        self._schedule.command(self._wanted)
        due = self._due() if self._plan is None else self._planned(self._plan)
        if due != self._told:
            self._give(self._given_ago(due))
            self._told = due
            self._hands.command(Keys(due))
        held = self._hands.step_frame()
        if self._plan is not None:
            self._plan.feel(action_of_keys(held))
        return held

    def _planned(self, plan: CommandPlan) -> int:
        """The keys that the plan tells the hands now."""
        schedule = self._schedule
        wanted = [action_of_keys(schedule.held_in(frames)) for frames in range(plan.frames)]
        action = plan.command(wanted, schedule.lead + 1)
        return int(KEYS_OF_ACTION[action])

    def _due(self) -> int:
        """The keys that the hands have to set out for now, to hold the right ones in time."""
        due, schedule = 0, self._schedule
        for (release, press, in_play), keys in self._keys_by_latency.items():
            coming = [
                schedule.held_in(frames)
                for frames in range(min(release, press), max(release, press) + 1)
            ]
            moving = [schedule.pressed_in_play(frames) for frames in range(press + 1, in_play + 1)]
            keys &= reduce(or_, moving, reduce(or_ if press > release else and_, coming))
            for pair in _OPPOSITES:
                if due & pair:  # a quicker key opposite is to be held sooner
                    keys &= ~pair
                elif keys & pair == pair:  # the hand stays where it is until it may leave
                    keys &= ~pair | self._told
            due |= keys
        return due

    def _given_ago(self, due: int) -> int:
        """How many emulator frames ago the agent gave the command by which ``due`` is due."""
        pressed = due & ~self._told
        changed = pressed or self._told & ~due
        own = [
            latency.press if pressed else latency.release
            for latency, keys in self._keys_by_latency.items()
            if keys & changed
        ]
        first = min(own)
        if self._plan is not None:  # it may set out sooner than that, for what comes later
            wanted = due & changed
            frames = range(first, self._plan.frames)
            held_in = self._schedule.held_in
            first = next((each for each in frames if held_in(each) & changed == wanted), first)
        return self._schedule.given_ago(changed, first)

    def _forget(self) -> None:
        self._wanted = self._told = 0
        self._schedule.forget()
        if self._plan is not None:
            self._plan.rest()
