"""An evaluator: an actor that only plays, to test the snapshots that the learner hands out."""

import time
from concurrent.futures import Future
from typing import Any

from actors.absence import Absence
from actors.counters import ActorCounters
from actors.envs.shown_env import ShownEnv
from actors.loop import play
from actors.member import Member
from actors.policy import Policy
from actors.stream.heartbeat import Heartbeat
from actors.stream.live_views import LiveViews
from common.errors import MessageError
from common.protocol.actor_stats import ActorStats
from common.protocol.chunk import Game
from common.protocol.evaluation import EvaluationJob, EvaluationReport
from common.protocol.weights import load_weights
from common.schedule import Every
from common.transport.interface import Envelope, Unanswered

_ASK_AGAIN = 0.5
_REFUSED_AGAIN = 10.0
"""Seconds after a job that was not taken, since the next one may be the same."""
_TIMEOUT = 5.0
_SIGN_SECONDS = 60.0
"""Seconds between two signs to the learner that a game goes on. A game may last for hours."""


class Evaluator:
    """Asks for jobs, plays them and reports each game; sends nothing to the replay.

    ``env`` plays whole games, and ``policy`` gets the weights and ε of each job.
    """

    def __init__(self, member: Member, env: ShownEnv[Any, Any], policy: Policy) -> None:
        self._member = member
        self._env = env
        self._policy = policy
        self._policy.epsilon = member.config.protocol.test_epsilon  # until a job has its own
        self._counters = ActorCounters(member.name, "evaluator", member.incarnation)
        self._jobs = member.transport.requester(member.keys.job(member.name), _TIMEOUT)
        self._reports = member.transport.requester(member.keys.report(member.name), _TIMEOUT)
        self._views = LiveViews(member, "evaluator", [env], policy)
        self._heartbeat = Heartbeat(member, "evaluator", self._stats)

    def run(self, seed: int) -> None:
        """Tests until the run is finished or ``stop`` is set.

        Raises:
            InputError: the learner went away for longer than the patience, or trains another run.
        """
        heard, absence = time.monotonic(), Absence(self._member, "learner", "evaluator")
        try:
            while not self._member.stop.is_set():
                try:
                    job = self._ask()
                except Unanswered:
                    absence.lasts(time.monotonic() - heard)
                    self._member.stop.wait(_ASK_AGAIN)
                    continue
                if job is not None and job.kind == "finished":
                    self._member.warn("the run is finished.")
                    return
                if job is not None and job.kind == "test":
                    self._play(job, seed)
                    seed += 1
                else:
                    self._member.stop.wait(_REFUSED_AGAIN if job is None else _ASK_AGAIN)
                heard = time.monotonic()
                absence.ends()
        finally:
            self._heartbeat.close()

    def _ask(self) -> EvaluationJob | None:
        """Returns the learner's answer; None if it cannot be used, which is told. Raises
        Unanswered."""
        try:
            job = EvaluationJob.decode(self._jobs.request(b"").result().payload)
            self._member.check_run(job.run_id)
            if job.kind == "test":
                told = job.epoch, job.run_id, job.weights, job.signature
                self._member.check_weights("test", *told)
                load_weights(self._policy.network, job.weights)
            return job
        except MessageError as error:
            self._member.warn(f"a job was not taken: {error}")
            return None

    def _play(self, job: EvaluationJob, seed: int) -> None:
        """Plays whole games until the steps of ``job`` are done, and reports each."""
        name, stop = self._member.name, self._member.stop
        self._policy.epsilon = job.epsilon
        self._policy.weights_version = job.epoch
        reported = games = 0
        signs, sign = Every(_SIGN_SECONDS, time.monotonic), None
        signs.restart()
        for steps, step in enumerate(play([self._env], self._policy, [seed]), start=1):
            self._counters.count(step)
            self._views.show(step)
            ended = step.info.game_over
            games += ended
            done = steps >= job.steps and games > 0
            if ended or done:
                found = (Game(step.info.game_score, step.info.game_steps),) if ended else ()
                report = EvaluationReport(
                    name, job.epoch, steps - reported, found, done, run_id=job.run_id
                )
                reported = steps
                if not self._report(report):
                    return
                signs.restart()
            elif sign is None and signs.is_due():
                sign = self._tell_that_it_goes_on(job)
            if sign is not None and sign.done():
                # No answer is not a no: the next report tells whether the test is forgotten.
                if isinstance(sign.exception(), MessageError):
                    return
                sign = None
            if done or stop.is_set():
                return

    def _report(self, report: EvaluationReport) -> bool:
        """Reports to the learner; returns whether it still wants this test.

        A learner that was away has forgotten the test, so no answer means no.
        """
        try:
            self._reports.request(report.encode()).result()
        except (MessageError, Unanswered):
            return False
        return True

    def _tell_that_it_goes_on(self, job: EvaluationJob) -> Future[Envelope]:
        """Tells the learner that a game of ``job`` goes on, which a game in real time does not wait
        for; the answer is a MessageError if the test has been given to another evaluator."""
        sign = EvaluationReport(self._member.name, job.epoch, 0, (), False, run_id=job.run_id)
        return self._reports.request(sign.encode())

    def _stats(self, leaving: bool) -> ActorStats:
        return self._counters.told(self._policy, leaving)
