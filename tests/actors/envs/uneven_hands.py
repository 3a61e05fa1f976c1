"""Hands of which each key takes its own time."""

from collections.abc import Mapping

from common.actions import OPPOSITES, Keys


class UnevenHands:
    """Releases and presses each key so many emulator frames after a command as ``latencies`` say:
    ``(release, press)`` by key, 0 for at the end of the frame that begins with it."""

    def __init__(self, latencies: Mapping[Keys, tuple[int, int]]) -> None:
        self.latencies = dict(latencies)
        self.rest()

    @property
    def held(self) -> Keys:
        return self._held

    def rest(self) -> None:
        self._held = self._wanted = Keys.NONE
        self._since = dict.fromkeys(self.latencies, 100)

    def command(self, keys: Keys) -> None:
        assert not any(keys & pair == pair for pair in OPPOSITES)
        for key in keys ^ self._wanted:
            self._since[key] = 0
        self._wanted = keys

    def step_frame(self) -> Keys:
        for key, latencies in self.latencies.items():
            wanted = self._wanted & key
            if self._since[key] >= latencies[bool(wanted)]:
                self._held = self._held & ~key | wanted
            self._since[key] += 1
        return self._held
