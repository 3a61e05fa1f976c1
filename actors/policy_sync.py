"""Keeps an actor up to date: the learner's weights, the run's present ε and difficulty."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

from actors.member import Member
from actors.policy import Policy
from actors.stream.weights_client import WeightsClient
from common.errors import MessageError
from common.protocol.ack import Ack
from common.protocol.weights import load_weights


class PolicySync:
    """Updates ``policy`` from what the learner and the replay send.

    Args:
        paused: returns a context for a wait, in which no game time passes.
    """

    def __init__(
        self,
        member: Member,
        policy: Policy,
        paused: Callable[[], AbstractContextManager[object]] = nullcontext,
    ) -> None:
        self._policy = policy
        self._weights = WeightsClient(member.transport, member.keys)
        self._config = member.config
        self._member = member
        self._paused = paused
        self._has_weights = False
        self._difficulty = 0.0
        """Difficulty of the next game, from the last acknowledgement."""

    def reset_options(self) -> dict[str, float]:
        """Returns the options of an environment's reset for the next game."""
        if not self._config.learning.curriculum_steps:  # an environment need not know the option
            return {}
        return {"difficulty": self._difficulty}

    def take_weights(self) -> None:
        """Uses the newest weights that have come."""
        found = self._weights.take()
        if found is None or (self._has_weights and found[0] == self._policy.weights_version):
            return
        version, payload, signature = found
        try:
            run_id = self._member.keys.run_id
            self._member.check_weights("training", version, run_id, payload, signature)
            load_weights(self._policy.network, payload)
        except MessageError as error:
            self._member.warn(f"weights {version} were not used: {error}")
            return
        self._policy.weights_version = version
        self._has_weights = True

    def follow(self, ack: Ack) -> None:
        """Takes ε and the games' difficulty from the run; fetches weights that were missed."""
        self._difficulty = ack.difficulty
        if not ack.finished and (not self._has_weights or self._lags(ack)):
            with self._paused():
                self._weights.fetch()
            self.take_weights()
        # An untrained network repeats one action, so all play is random until the learner is there.
        epsilon = self._config.epsilon_at(ack.agent_steps)
        self._policy.epsilon = epsilon if self._has_weights else 1.0

    def _lags(self, ack: Ack) -> bool:
        """Whether a broadcast was missed, or the learner came back with older weights.

        One broadcast may still be on its way when the acknowledgement comes; two cannot.
        """
        away = abs(ack.weights_version - self._policy.weights_version)
        return away > 2 * self._config.learning.publish_period
