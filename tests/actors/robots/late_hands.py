"""Hands of known latency, for whatever measures it."""

from collections.abc import Collection

from common.actions import Keys


class LateHands:
    """Hands that need ``delay`` frames, press ``stray`` on the way, and obey no command of
    ``never``."""

    def __init__(
        self, delay: int, *, never: Collection[Keys] = (), stray: Keys = Keys.NONE
    ) -> None:
        self._delay = delay
        self._never = never
        self._stray = stray
        self.rest()

    @property
    def held(self) -> Keys:
        return self._pressed

    def rest(self) -> None:
        self._wanted = self._pressed = Keys.NONE
        self._since = 0

    def command(self, keys: Keys) -> None:
        if keys != self._wanted:
            self._wanted, self._since = keys, 0

    def step_frame(self) -> Keys:
        self._since += 1
        if self._since >= self._delay and self._wanted not in self._never:
            self._pressed = self._wanted
        elif self._since == 1:
            return self._pressed | self._stray
        return self._pressed

    def close(self) -> None:
        pass
