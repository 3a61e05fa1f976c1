"""Counts what an actor process has lived through."""

import time

from actors.loop import Step
from actors.policy import Policy
from common.press_latency import COUNTS
from common.protocol.actor_stats import ActorStats, Role


class ActorCounters:
    """Steps, how many of them were seen and felt, and the pauses."""

    def __init__(self) -> None:
        self.steps = 0
        self.held_seconds = 0.0
        self.decisions = 0
        """Of game time that the steps took."""
        self.missed_deadlines = 0
        """Decisions that passed before their command was there, because the agent was too slow;
        only where the world goes on in real time."""
        self.late_frames = 0
        """Frames that began more than a frame too late, because the machine was too slow."""
        self.waits_given_up = 0
        """Steps that ended at the bound of their wait, without the commanded keys."""
        self.key_times = [0] * COUNTS
        """How long the hands took, see `common.press_latency`."""
        self.valid = 0
        """Steps whose frame showed the screen."""
        self.matched = 0
        """Steps that ended with the commanded keys pressed."""
        self._looked = (time.monotonic(), 0, 0.0)

    def count(self, step: Step) -> None:
        self.steps += 1
        self.valid += step.valid
        self.matched += bool(step.info["keys_match"])
        self.decisions += step.info["elapsed"]
        # Only a robot's environment has the rest.
        self.missed_deadlines += step.info.get("missed_deadlines", 0)
        self.late_frames += step.info.get("late_frames", 0)
        self.waits_given_up += step.info.get("gave_up", False)
        for place in step.info.get("key_times", ()):
            self.key_times[place] += 1

    @property
    def valid_share(self) -> float:
        return self.valid / max(self.steps, 1)

    @property
    def match_share(self) -> float:
        return self.matched / max(self.steps, 1)

    def stats(
        self, name: str, role: Role, incarnation: int, policy: Policy, leaving: bool
    ) -> ActorStats:
        """What the process tells about itself, without chunks; rates are since the last call."""
        rate, held = self.rates()
        return ActorStats(
            name=name,
            role=role,
            incarnation=incarnation,
            leaving=leaving,
            steps=self.steps,
            steps_per_second=rate,
            epsilon=policy.random_share,
            weights_version=policy.weights_version,
            made=0,
            acked=0,
            retried=0,
            refused=0,
            held_share=held,
            valid_share=self.valid_share,
            match_share=self.match_share,
            decisions=self.decisions,
            missed_deadlines=self.missed_deadlines,
            late_frames=self.late_frames,
            waits_given_up=self.waits_given_up,
            key_times=tuple(self.key_times),
        )

    def rates(self) -> tuple[float, float]:
        """Steps per second, and the share of time held, since the last call."""
        then, steps, held = self._looked
        now = time.monotonic()
        self._looked = (now, self.steps, self.held_seconds)
        seconds = max(now - then, 1e-6)
        return (self.steps - steps) / seconds, min((self.held_seconds - held) / seconds, 1.0)
