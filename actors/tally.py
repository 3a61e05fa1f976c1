"""Counts what an actor process has lived through."""

import time

from actors.loop import Step


class Tally:
    """Steps, how many of them were seen and felt, and the pauses."""

    def __init__(self) -> None:
        self.steps = 0
        self.held_seconds = 0.0
        self._valid = 0
        self._matched = 0
        self._looked = (time.monotonic(), 0, 0.0)

    def count(self, step: Step) -> None:
        self.steps += 1
        self._valid += step.valid
        self._matched += bool(step.info["keys_match"])

    @property
    def valid_share(self) -> float:
        """Share of the steps whose frame showed the screen."""
        return self._valid / max(self.steps, 1)

    @property
    def match_share(self) -> float:
        """Share of the steps that ended with the commanded keys pressed."""
        return self._matched / max(self.steps, 1)

    def rates(self) -> tuple[float, float]:
        """Steps per second, and the share of time held, since the last call."""
        then, steps, held = self._looked
        now = time.monotonic()
        self._looked = (now, self.steps, self.held_seconds)
        seconds = max(now - then, 1e-6)
        return (self.steps - steps) / seconds, min((self.held_seconds - held) / seconds, 1.0)
