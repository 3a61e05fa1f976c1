"""A training actor's life: it joins, plays, sends its transitions, pauses when told, and leaves."""

import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import gymnasium

from actors.counters import ActorCounters
from actors.loop import play
from actors.policy import Policy
from actors.policy_sync import PolicySync
from actors.stream.chunker import Chunker
from actors.stream.heartbeat import Heartbeat
from actors.stream.insert_client import InsertClient
from actors.stream.weights_client import WeightsClient
from common.protocol.ack import Ack
from common.protocol.actor_stats import ActorStats
from common.protocol.run_keys import RunKeys
from common.run.config import RunConfig
from common.transport.interface import Transport

FAREWELL = 2.0
"""Seconds that a leaving actor waits for its last acknowledgements."""


class Actor:
    """One actor process' work.

    Args:
        incarnation: differs for each start of the process.
        envs: its environments, all played with one forward pass.
        patience: seconds to wait for a hub that went away.
        stop: set from outside to make it leave, and from inside when the run is finished.
        warn: takes a sentence for people.
    """

    def __init__(
        self,
        transport: Transport,
        config: RunConfig,
        keys: RunKeys,
        name: str,
        incarnation: int,
        envs: Sequence[gymnasium.Env[Any, Any]],
        policy: Policy,
        *,
        patience: float,
        stop: threading.Event,
        warn: Callable[[str], None],
    ) -> None:
        self._envs = envs
        self._policy = policy
        self._stop = stop
        self._warn = warn
        self._counters = ActorCounters(name, "actor", incarnation)
        self._sync = PolicySync(policy, WeightsClient(transport, keys), config, warn)
        self._inserts = InsertClient(
            transport,
            keys.insert(name),
            config.stream.window,
            patience=patience,
            stopped=stop.is_set,
            warn=warn,
        )
        self._chunkers = [
            Chunker(keys.run, name, incarnation, stream, config.stream.chunk_steps)
            for stream in range(len(envs))
        ]
        self._heartbeat = Heartbeat(transport, keys, "actor", name, self._stats)

    def run(self, seeds: Sequence[int]) -> None:
        """Play until the run is over or ``stop`` is set; ``seeds`` has one for each environment.

        Raises:
            InputError: the hub went away for longer than the patience.
        """
        try:
            self._obey(self._inserts.poll())
            for step in play(self._envs, self._policy, seeds):
                self._counters.count(step)
                self._sync.take_weights()
                chunk = self._chunkers[step.stream].add(step)
                if chunk is not None:
                    self._inserts.send(chunk.encode())
                    self._obey(self._inserts.last_ack)
                    self._pause_while_throttled()
                if self._stop.is_set():
                    break
        finally:
            self._leave()

    def _obey(self, ack: Ack | None) -> None:
        """Follow what the replay said last."""
        if ack is not None:
            self._sync.follow(ack)
            if ack.finished:
                self._stop.set()

    def _pause_while_throttled(self) -> None:
        began = time.monotonic()
        ack = self._inserts.last_ack
        while ack is not None and ack.throttle and not self._stop.is_set():
            answer = self._inserts.poll()
            self._obey(answer)
            ack = answer or ack
            self._sync.take_weights()
        self._counters.held_seconds += time.monotonic() - began

    def _leave(self) -> None:
        for chunker in self._chunkers:
            chunk = chunker.cut()
            if chunk is not None:
                self._inserts.post(chunk.encode())
        self._inserts.flush(FAREWELL)
        if self._inserts.unacknowledged:
            self._warn(f"{self._inserts.unacknowledged} chunks were never acknowledged.")
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
