"""Counts the steps of an actor process and what became of them."""

import socket
import time
from collections import deque
from dataclasses import replace
from typing import Any

from actors.loop import Step
from actors.policy import Policy
from common.checked import MAX_TEXT
from common.press_latency import COUNTS
from common.process.footprint import footprint
from common.protocol.actor_stats import ActorStats, Role

WINDOW = 10.0
"""Seconds over which rates are computed; a throttled actor plays in bursts."""


class ActorCounters:
    """Counters of one process; `stats` grows with each step."""

    def __init__(self, name: str = "", role: Role = "actor", incarnation: int = 0) -> None:
        self.stats = ActorStats(name, role, incarnation, machine=socket.gethostname()[:MAX_TEXT])
        self.throttled_seconds = 0.0
        self.follows = 0
        """Steps whose frames changed as the game's own pictures did."""
        self.key_times = [0] * COUNTS
        """How long the hands took; see `common.press_latency`."""
        self._began = time.monotonic()
        self._looks = deque([(self._began, 0, 0.0, time.process_time())])

    def count(self, step: Step) -> None:
        stats, info = self.stats, step.info
        stats.steps += 1
        stats.valid += step.valid
        stats.matched += info.keys_match
        self.follows += info.frame_follows
        stats.decisions += info.elapsed
        stats.missed_deadlines += info.missed_deadlines
        stats.late_frames += info.late_frames
        stats.waits_given_up += info.gave_up
        for place in info.key_times:
            self.key_times[place] += 1

    def told(self, policy: Policy, leaving: bool, **chunks: Any) -> ActorStats:
        """Returns what the process reports about itself now, with the rates of the last `WINDOW`.

        Args:
            chunks: counters of the insert client, by their field in `ActorStats`.
        """
        rate, throttled, busy = self.rates()
        return replace(
            self.stats,
            leaving=leaving,
            seconds=time.monotonic() - self._began,
            busy_cores=busy,
            memory_bytes=footprint().private,
            steps_per_second=rate,
            throttled_share=throttled,
            epsilon=policy.epsilon,
            weights_version=policy.weights_version,
            key_times=tuple(self.key_times),
            **chunks,
        )

    def rates(self) -> tuple[float, float, float]:
        """Returns the rates of the last `WINDOW`: steps per second, the share of time throttled,
        and seconds of processor time per second."""
        now, worked = time.monotonic(), time.process_time()
        self._looks.append((now, self.stats.steps, self.throttled_seconds, worked))
        while now - self._looks[0][0] > WINDOW:
            self._looks.popleft()
        then, steps, throttled, worked_then = self._looks[0]
        seconds = max(now - then, 1e-6)
        share = min((self.throttled_seconds - throttled) / seconds, 1.0)
        return (self.stats.steps - steps) / seconds, share, (worked - worked_then) / seconds
