"""A training actor: plays, streams what it lives through, and takes new weights as they come."""

import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import gymnasium

from actors.counters import ActorCounters
from actors.loop import play
from actors.policy import Policy
from actors.stream.chunker import Chunker
from actors.stream.heartbeat import Heartbeat
from actors.stream.insert_client import InsertClient
from actors.stream.weights_client import WeightsClient
from common.errors import MessageError
from common.protocol.ack import Ack
from common.protocol.actor_stats import ActorStats
from common.protocol.run_keys import RunKeys
from common.protocol.weights import load_weights
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
        self._config = config
        self._envs = envs
        self._policy = policy
        self._stop = stop
        self._warn = warn
        self._counters = ActorCounters(name, "actor", incarnation)
        self._has_weights = False
        self._inbox = WeightsClient(transport, keys)
        self._outbox = InsertClient(
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
            self._steer(self._outbox.poll())
            for step in play(self._envs, self._policy, seeds):
                self._counters.count(step)
                self._take_weights()
                chunk = self._chunkers[step.stream].add(step)
                if chunk is not None:
                    self._outbox.send(chunk.encode())
                    self._steer(self._outbox.last_ack)
                    self._rest()
                if self._stop.is_set():
                    break
        finally:
            self._leave()

    def _take_weights(self) -> None:
        found = self._inbox.take()
        if found is None or (self._has_weights and found[0] == self._policy.weights_version):
            return
        version, payload = found
        try:
            load_weights(self._policy.network, payload)
        except MessageError as error:
            self._warn(f"weights {version} were not used: {error}")
            return
        self._policy.weights_version = version
        self._has_weights = True

    def _steer(self, ack: Ack | None) -> None:
        """Follow what the replay said last."""
        if ack is None:
            return
        self._policy.epsilon = self._config.epsilon_at(ack.agent_steps)
        if ack.finished:
            self._stop.set()
        elif not self._has_weights or self._lags(ack):
            self._inbox.fetch()
            self._take_weights()

    def _lags(self, ack: Ack) -> bool:
        """Whether a broadcast was missed, or those of a learner that came back with older weights.

        The next one is on its way while the acknowledgement is; two away is a loss.
        """
        away = abs(ack.weights_version - self._policy.weights_version)
        return away > 2 * self._config.learning.publish_period

    def _rest(self) -> None:
        """Pause while the learner is behind."""
        began = time.monotonic()
        ack = self._outbox.last_ack
        while ack is not None and ack.throttle and not self._stop.is_set():
            answer = self._outbox.poll()
            self._steer(answer)
            ack = answer or ack
            self._take_weights()
        self._counters.held_seconds += time.monotonic() - began

    def _leave(self) -> None:
        for chunker in self._chunkers:
            chunk = chunker.cut()
            if chunk is not None:
                self._outbox.post(chunk.encode())
        self._outbox.flush(FAREWELL)
        if self._outbox.unacknowledged:
            self._warn(f"{self._outbox.unacknowledged} chunks were never acknowledged.")
        self._heartbeat.close()

    def _stats(self, leaving: bool) -> ActorStats:
        outbox = self._outbox
        return self._counters.told(
            self._policy,
            leaving,
            made=outbox.made,
            acked=outbox.acked,
            retried=outbox.retried,
            refused=outbox.refused,
        )
