"""A training actor: it plays, sends its transitions, pauses when told to, and leaves."""

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

from actors.counters import ActorCounters
from actors.envs.shown_env import ShownEnv
from actors.loop import Step, play
from actors.member import Member
from actors.policy import Policy
from actors.policy_sync import PolicySync
from actors.stream.chunker import Chunker
from actors.stream.heartbeat import Heartbeat
from actors.stream.insert_client import InsertClient
from actors.stream.live_views import LiveViews
from common.counted import counted
from common.protocol.ack import Ack
from common.protocol.actor_stats import ActorStats

FAREWELL = 10.0
"""Seconds that a leaving actor waits for its last acknowledgements. Meanwhile it resends inserts
that were lost on the way."""


class Actor:
    """The work of one actor process, which plays all ``envs`` with one forward pass."""

    def __init__(self, member: Member, envs: Sequence[ShownEnv[Any, Any]], policy: Policy) -> None:
        self._member = member
        self._envs = envs
        self._policy = policy
        self._counters = ActorCounters(member.name, "actor", member.incarnation)
        self._sync = PolicySync(member, policy, self._paused)
        self._inserts = InsertClient(member, self._paused)
        self._obeyed: Ack | None = None
        self._chunkers = [
            Chunker(
                member.keys.run_id,
                member.name,
                member.incarnation,
                stream,
                member.config.stream.chunk_steps,
            )
            for stream in range(len(envs))
        ]
        self._views = LiveViews(member, "actor", envs, policy)
        self._heartbeat = Heartbeat(member, "actor", self._stats)

    def run(self, seeds: Sequence[int]) -> None:
        """Plays until the run is over or ``stop`` is set; ``seeds`` has one for each environment.

        Raises:
            InputError: the hub went away for longer than the patience, or serves another run.
        """
        try:
            self._obey(self._inserts.poll())
            if self._member.stop.is_set():  # before a robot is built for a run that is over
                return
            for step in play(self._envs, self._policy, seeds, self._sync.reset_options):
                self._counters.count(step)
                self._views.show(step)
                self._sync.take_weights()
                chunk = self._chunkers[step.stream].add(step)
                if chunk is not None:
                    self._inserts.send(chunk.encode())
                self._obey(self._inserts.last_ack)
                if chunk is not None:
                    self._pause_while_throttled(step)
                if self._member.stop.is_set():
                    break
        finally:
            self._leave()

    def _obey(self, ack: Ack | None) -> None:
        """Does what the replay's latest acknowledgement says, once."""
        if ack is not self._obeyed and ack is not None:
            self._obeyed = ack
            self._member.check_run(ack.run_id)
            self._sync.follow(ack)
            if ack.finished and not self._member.stop.is_set():
                self._member.warn(
                    "the run is finished."
                    if self._counters.stats.steps
                    else "the run has all its steps already: resume its learner with more --steps, "
                    "then start this actor again."
                )
                self._member.stop.set()

    @contextmanager
    def _paused(self) -> Iterator[None]:
        """Lets no game time pass while this actor waits, or it would come back to other games than
        it left, and its next transitions would have that gap."""
        with ExitStack() as stack:
            for env in self._envs:
                stack.enter_context(env.paused())
            yield

    def _pause_while_throttled(self, step: Step) -> None:
        ack = self._inserts.last_ack
        if ack is not None and ack.throttle:
            with self._paused():
                self._wait_while_throttled(ack, step)

    def _wait_while_throttled(self, ack: Ack, step: Step) -> None:
        then = time.monotonic()
        while ack.throttle and not self._member.stop.is_set():
            answer = self._inserts.poll()
            self._obey(answer)
            ack = answer or ack
            self._sync.take_weights()
            self._views.show(step)
            # At each turn, because heartbeats report it meanwhile.
            now = time.monotonic()
            self._counters.throttled_seconds += now - then
            then = now

    def _leave(self) -> None:
        for chunker in self._chunkers:
            chunk = chunker.cut()
            if chunk is not None:
                self._inserts.post(chunk.encode())
        self._inserts.flush(FAREWELL)
        if self._inserts.unacknowledged:
            lost = counted(self._inserts.unacknowledged, "chunk")
            self._member.warn(f"the replay did not acknowledge the last {lost}.")
        elif steps := self._counters.stats.steps:
            stored = "" if self._inserts.refused else ", all of them stored"
            self._member.warn(f"left after {counted(steps, 'step')}{stored}.")
        self._heartbeat.close()

    def _stats(self, leaving: bool) -> ActorStats:
        inserts = self._inserts
        return self._counters.told(
            self._policy,
            leaving,
            made=inserts.made,
            acked=inserts.acked,
            retried=inserts.retried,
            refused=inserts.refused,
        )
