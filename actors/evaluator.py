"""An evaluator: an actor that only plays. It tests the snapshots that the learner hands out."""

import threading
import time
from collections.abc import Callable
from typing import Any

import gymnasium

from actors.counters import ActorCounters
from actors.loop import play
from actors.policy import Policy
from actors.stream.heartbeat import Heartbeat
from common.errors import InputError, MessageError
from common.protocol.actor_stats import ActorStats
from common.protocol.chunk import Game
from common.protocol.evaluation import EvaluationJob, EvaluationReport
from common.protocol.run_keys import RunKeys
from common.protocol.weights import load_weights
from common.transport.interface import Transport, Unanswered

_ASK_AGAIN = 0.5
_TIMEOUT = 5.0


class Evaluator:
    """Asks for a job, plays it, reports each game; nothing it sees goes to the replay.

    Args:
        env: plays whole games.
        policy: gets the weights and ε of each job.
        patience: seconds to wait for a learner that went away.
        stop: set from outside to make it leave.
        warn: takes a sentence for people.
    """

    def __init__(
        self,
        transport: Transport,
        keys: RunKeys,
        name: str,
        incarnation: int,
        env: gymnasium.Env[Any, Any],
        policy: Policy,
        *,
        patience: float,
        stop: threading.Event,
        warn: Callable[[str], None],
    ) -> None:
        self._name = name
        self._env = env
        self._policy = policy
        self._patience = patience
        self._stop = stop
        self._warn = warn
        self._counters = ActorCounters(name, "evaluator", incarnation)
        self._jobs = transport.requester(keys.task, _TIMEOUT)
        self._reports = transport.requester(keys.report, _TIMEOUT)
        self._heartbeat = Heartbeat(transport, keys, "evaluator", name, self._stats)

    def run(self, seed: int) -> None:
        """Test until the run is finished or ``stop`` is set.

        Raises:
            InputError: the learner went away for longer than the patience.
        """
        heard = time.monotonic()
        try:
            while not self._stop.is_set():
                job = self._ask()
                if job is not None and job.kind == "finished":
                    return
                if job is not None and job.kind == "test":
                    self._play(job, seed)
                    seed += 1
                else:
                    self._stop.wait(_ASK_AGAIN)
                if job is not None:
                    heard = time.monotonic()
                elif time.monotonic() - heard > self._patience:
                    raise InputError(
                        f"the learner went away and did not come back in {self._patience:.0f} s: "
                        "start it again with --resume, then start this evaluator."
                    )
        finally:
            self._heartbeat.close()

    def _ask(self) -> EvaluationJob | None:
        try:
            job = EvaluationJob.decode(self._jobs.request(self._name.encode()).result().payload)
            if job.kind == "test":
                load_weights(self._policy.network, job.weights)
            return job
        except MessageError as error:
            self._warn(f"a job was not taken: {error}")
        except Unanswered:
            pass
        return None

    def _play(self, job: EvaluationJob, seed: int) -> None:
        """Play whole games until the steps of ``job`` are done, and report each."""
        self._policy.epsilon = job.epsilon
        self._policy.weights_version = job.epoch
        reported = games = 0
        for steps, step in enumerate(play([self._env], self._policy, [seed]), start=1):
            self._counters.count(step)
            ended = step.info.game_over
            games += ended
            done = steps >= job.steps and games > 0
            if ended or done:
                found = (Game(step.info.game_score, step.info.game_steps),) if ended else ()
                report = EvaluationReport(self._name, job.epoch, steps - reported, found, done)
                reported = steps
                if not self._report(report):
                    return
            if done or self._stop.is_set():
                return

    def _report(self, report: EvaluationReport) -> bool:
        """Whether the learner still wants this test; a learner that is away does not know it."""
        try:
            self._reports.request(report.encode()).result()
        except (MessageError, Unanswered):
            return False
        return True

    def _stats(self, leaving: bool) -> ActorStats:
        return self._counters.told(self._policy, leaving)
