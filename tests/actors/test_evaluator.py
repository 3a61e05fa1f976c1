"""The evaluator, with a learner that the test plays."""

import threading
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from actors import evaluator as evaluator_module
from actors.envs.checked import CheckedEnv
from actors.evaluator import Evaluator
from actors.member import Member
from actors.policy import Policy
from common.errors import InputError, MessageError
from common.network import QNetwork
from common.protocol.actor_stats import ActorStats
from common.protocol.chunk import Game
from common.protocol.evaluation import EvaluationJob, EvaluationReport
from common.protocol.run_keys import RunKeys
from common.protocol.weights import encode_weights
from common.settings.presets import PRESETS
from common.transport.interface import Envelope, Transport
from common.transport.signature import Check, unchecked
from tests.actors.numbered_env import GAME_OVER, GOES_ON, NumberedEnv
from tests.hub_stubs import PendingRequests
from tests.patience import PATIENCE, wait_until

KEYS = RunKeys("r")
WEIGHTS = encode_weights(QNetwork(6))
TEN_STEPS_A_GAME = [*[GOES_ON] * 9, GAME_OVER]


class Stage:
    """An evaluator at work in a thread, and the learner's side of its keys."""

    def __init__(self, hub: Transport, client: Transport) -> None:
        self.jobs = PendingRequests(hub, KEYS.job("*"))
        self.reports = PendingRequests(hub, KEYS.report("*"))
        self.warnings: list[str] = []
        self.stop = threading.Event()
        self.failure: Exception | None = None
        self.check_weights: Check = unchecked
        self._client = client
        self._thread: threading.Thread | None = None

    def start(self, env: NumberedEnv, patience: float = 300.0) -> Policy:
        policy = Policy(QNetwork(6), 6, np.random.default_rng(0))
        member = Member(
            *("e", self._client, KEYS, PRESETS["fast"], patience, self.stop, 9),
            *(self.warnings.append, self.check_weights),
        )
        evaluator = Evaluator(member, CheckedEnv(env, PRESETS["fast"]), policy)

        def work() -> None:
            try:
                evaluator.run(seed=40)
            except InputError as error:
                self.failure = error

        self._thread = threading.Thread(target=work, daemon=True)
        self._thread.start()
        return policy

    def give(self, job: EvaluationJob) -> None:
        query = self.jobs.next()
        assert (query.key, query.payload) == (KEYS.job("e"), b"")
        query.reply(job.encode())

    def report(self) -> EvaluationReport:
        """The next report, which the learner takes."""
        query = self.reports.next()
        assert query.key == KEYS.report("e")
        found = EvaluationReport.decode(query.payload)
        query.reply(b"")
        return found

    def test(self) -> list[EvaluationReport]:
        """All reports up to the last of a test."""
        found = [self.report()]
        while not found[-1].done:
            found.append(self.report())
        return found

    def ended(self) -> None:
        assert self._thread is not None
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()

    def close(self) -> None:
        self.stop.set()
        self.jobs.close()
        self.reports.close()
        self.ended()


@pytest.fixture
def stage(hub: Transport, client: Transport, monkeypatch: pytest.MonkeyPatch) -> Iterator[Stage]:
    monkeypatch.setattr(evaluator_module, "_ASK_AGAIN", 0.02)
    monkeypatch.setattr(evaluator_module, "_REFUSED_AGAIN", 0.02)
    monkeypatch.setattr(evaluator_module, "_TIMEOUT", PATIENCE / 2)  # whatever holds the test up
    stage = Stage(hub, client)
    yield stage
    stage.close()


def job(steps: int, epoch: int = 3, epsilon: float = 1.0) -> EvaluationJob:
    return EvaluationJob("test", epoch, steps, epsilon, WEIGHTS)


FINISHED = EvaluationJob("finished")


def test_a_job_is_played_to_its_steps_and_each_game_reported(stage: Stage) -> None:
    env = NumberedEnv(TEN_STEPS_A_GAME)
    policy = stage.start(env)
    stage.give(job(steps=25, epsilon=0.5))
    reports = stage.test()
    assert [(report.steps, len(report.games), report.done) for report in reports] == [
        (10, 1, False),
        (10, 1, False),
        (5, 0, True),
    ]
    assert {(report.evaluator, report.epoch) for report in reports} == {("e", 3)}
    stage.give(FINISHED)
    stage.ended()
    assert len(env.moments) == 25
    games = [game for report in reports for game in report.games]
    assert games == [Game(moment.info["game_score"], 10) for moment in env.moments[9::10]]
    assert (policy.epsilon, policy.weights_version) == (0.5, 3)
    assert stage.failure is None


def test_a_game_that_goes_on_is_told(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evaluator_module, "_SIGN_SECONDS", 0.0)
    stage.start(NumberedEnv(TEN_STEPS_A_GAME))
    stage.give(job(steps=15))
    reports = [(told.steps, len(told.games), told.done) for told in stage.test()]
    assert reports[0] == (0, 0, False)
    assert [told for told in reports if told != (0, 0, False)] == [(10, 1, False), (5, 0, True)]


def test_a_sign_waits_for_the_one_before(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    """And the game waits for none: in real time its hands would stand still."""
    monkeypatch.setattr(evaluator_module, "_SIGN_SECONDS", 0.0)
    stage.start(NumberedEnv(TEN_STEPS_A_GAME))
    stage.give(job(steps=5))
    sign, report = stage.reports.next(), stage.reports.next()
    assert EvaluationReport.decode(sign.payload).steps == 0
    assert EvaluationReport.decode(report.payload).done
    report.reply(b"")
    stage.give(FINISHED)


def test_a_report_is_a_sign_too(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    """A step takes a second, a game 10, and a sign is due after 15 without a report."""
    env = NumberedEnv(TEN_STEPS_A_GAME)
    clock = SimpleNamespace(monotonic=lambda: float(len(env.moments)))
    monkeypatch.setattr(evaluator_module, "time", clock)
    monkeypatch.setattr(evaluator_module, "_SIGN_SECONDS", 15.0)
    stage.start(env)
    stage.give(job(steps=40))
    assert [report.steps for report in stage.test()] == [10] * 4
    stage.give(FINISHED)


@pytest.mark.parametrize("answers", [True, False])
def test_only_a_learner_that_refuses_the_sign_ends_the_test(
    stage: Stage, monkeypatch: pytest.MonkeyPatch, answers: bool
) -> None:
    monkeypatch.setattr(evaluator_module, "_SIGN_SECONDS", 0.0)
    monkeypatch.setattr(evaluator_module, "_TIMEOUT", PATIENCE / 2 if answers else 0.1)
    # With an answer, a game that never ends.
    env = NumberedEnv([GOES_ON] if answers else TEN_STEPS_A_GAME)
    stage.start(env)
    stage.give(job(steps=2))
    sign = stage.reports.next()
    assert EvaluationReport.decode(sign.payload).steps == 0
    if answers:
        sign.refuse("that test was given to somebody else")
    else:
        while not EvaluationReport.decode((report := stage.reports.next()).payload).done:
            pass
        report.reply(b"")
    stage.give(FINISHED)
    stage.ended()
    assert answers or len(env.moments) == 10


@pytest.mark.parametrize("steps", [10, 20])
def test_a_test_that_ends_with_a_game_reports_both_at_once(stage: Stage, steps: int) -> None:
    stage.start(NumberedEnv(TEN_STEPS_A_GAME))
    stage.give(job(steps))
    reports = stage.test()
    assert [report.steps for report in reports] == [10] * (steps // 10)
    assert (len(reports[-1].games), reports[-1].done) == (1, True)


def test_a_test_lasts_for_one_whole_game_at_least(stage: Stage) -> None:
    env = NumberedEnv(TEN_STEPS_A_GAME)
    stage.start(env)
    stage.give(job(steps=3))
    (report,) = stage.test()
    assert (report.steps, len(report.games)) == (10, 1)
    stage.give(FINISHED)
    stage.ended()
    assert len(env.moments) == 10


def test_each_test_plays_other_games_with_its_own_snapshot(stage: Stage) -> None:
    env = NumberedEnv(TEN_STEPS_A_GAME)
    policy = stage.start(env)
    learned = QNetwork(6)
    stage.give(EvaluationJob("test", 1, 10, 1.0, WEIGHTS))
    stage.test()
    stage.give(EvaluationJob("test", 2, 10, 0.25, encode_weights(learned)))
    stage.test()
    stage.give(FINISHED)
    stage.ended()
    assert env.seeds == [40, 41]
    assert (policy.epsilon, policy.weights_version) == (0.25, 2)
    assert encode_weights(policy.network) == encode_weights(learned)


def test_it_waits_for_as_long_as_it_is_told(stage: Stage) -> None:
    env = NumberedEnv(TEN_STEPS_A_GAME)
    stage.start(env)
    for _ in range(3):
        stage.give(EvaluationJob("wait"))
    stage.give(FINISHED)
    stage.ended()
    assert env.moments == []


def test_a_test_that_the_learner_does_not_want_any_more_ends(stage: Stage) -> None:
    env = NumberedEnv(TEN_STEPS_A_GAME)
    stage.start(env)
    stage.give(job(steps=1_000))
    stage.reports.next().refuse("epoch 3 is not being tested")
    stage.give(FINISHED)
    stage.ended()
    assert len(env.moments) == 10


@pytest.mark.parametrize(
    ("payload", "sentence"),
    [
        (b"garbage", "not msgpack"),
        (EvaluationJob("test", 1, 10, 0.0, b"no weights").encode(), "not safetensors"),
        (
            EvaluationJob("test", 1, 10, 0.0, encode_weights(QNetwork(4))).encode(),
            "where the network has",
        ),
    ],
    ids=["garbage", "no weights", "weights of another network"],
)
def test_a_malformed_job_is_told_and_not_played(
    stage: Stage, payload: bytes, sentence: str
) -> None:
    env = NumberedEnv(TEN_STEPS_A_GAME)
    stage.start(env)
    stage.jobs.next().reply(payload)
    stage.give(FINISHED)
    stage.ended()
    assert env.moments == []
    told, finished = stage.warnings
    assert sentence in told
    assert finished == "e: the run is finished."


def test_a_learner_that_was_away_for_a_moment_is_asked_again(stage: Stage) -> None:
    stage.start(NumberedEnv(TEN_STEPS_A_GAME))
    for _ in range(3):
        stage.jobs.next().drop()
    stage.give(job(steps=10))
    assert len(stage.test()) == 1


def test_people_are_told_that_the_learner_is_away_and_back(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("actors.absence._TELL_AFTER", 0.1)
    stage.start(NumberedEnv(TEN_STEPS_A_GAME))
    while not stage.warnings:
        stage.jobs.next().drop()
    stage.give(EvaluationJob("wait"))
    wait_until(lambda: len(stage.warnings) == 2, "the learner is back")
    assert stage.warnings == [
        "e: the learner does not answer: waiting up to 300 s for it.",
        "e: the learner answers again.",
    ]


def test_a_learner_that_stays_away_is_given_up(stage: Stage) -> None:
    stage.jobs.close()
    stage.start(NumberedEnv(TEN_STEPS_A_GAME), patience=0.1)
    stage.ended()
    assert "the learner went away and did not come back" in str(stage.failure)


def test_a_wish_to_stop_ends_a_test(stage: Stage) -> None:
    env = NumberedEnv(TEN_STEPS_A_GAME)
    stage.start(env)
    stage.give(job(steps=10**9))
    query = stage.reports.next()
    stage.stop.set()
    query.reply(b"")
    stage.ended()
    assert len(env.moments) == 10
    assert stage.failure is None


def test_it_lives_and_says_so_until_it_leaves(stage: Stage, hub: Transport) -> None:
    heard: list[ActorStats] = []

    def receive(message: Envelope) -> None:
        heard.append(ActorStats.decode(message.payload))

    hub.subscribe(KEYS.stats("evaluator", "e"), receive)
    presence: list[tuple[str, bool]] = []
    hub.watch_presence(KEYS.live("*", "*"), lambda *news: presence.append(news))
    stage.start(NumberedEnv(TEN_STEPS_A_GAME))

    wait_until(lambda: presence == [(KEYS.live("evaluator", "e"), True)], "it is alive")
    stage.give(job(steps=10))
    stage.test()
    stage.give(FINISHED)
    stage.ended()
    wait_until(lambda: any(stats.leaving for stats in heard), "it says good-bye")
    last = heard[-1]
    assert (last.role, last.name, last.incarnation, last.steps) == ("evaluator", "e", 9, 10)
    # Frames 5 and 10 of 11 were not seen; the keys matched at the even ones.
    assert last.valid_share == 0.8
    assert last.match_share == 0.5
    wait_until(lambda: presence[1:] == [(KEYS.live("evaluator", "e"), False)], "it is gone")


def test_an_evaluator_leaves_a_learner_that_trains_another_run_now(stage: Stage) -> None:
    """Or it would play the old game with the new one's weights, if they fit."""
    stage.start(NumberedEnv(TEN_STEPS_A_GAME))
    stage.give(replace(job(25), run_id="another"))
    stage.ended()
    assert "serves a different run under the name r, and refuses e" in str(stage.failure)


def test_a_learner_whose_jobs_are_refused_is_not_away(stage: Stage) -> None:
    def check(*told: object) -> None:
        raise MessageError("they are not signed")

    stage.check_weights = check
    stage.start(NumberedEnv(TEN_STEPS_A_GAME), patience=0.0)
    for _ in range(3):
        stage.give(job(10))
    stage.give(FINISHED)
    stage.ended()
    assert stage.failure is None
    assert stage.warnings == [
        *["e: a job was not taken: they are not signed"] * 3,
        "e: the run is finished.",
    ]


def test_a_job_with_weights_that_the_learner_did_not_sign_is_not_taken(stage: Stage) -> None:
    checked: list[tuple[object, ...]] = []

    def check(*told: object) -> None:
        checked.append(told)
        if told[-1] != b"signed":
            raise MessageError("they are not signed")

    stage.check_weights = check
    job = EvaluationJob("test", 3, 10, 0.1, WEIGHTS)
    policy = stage.start(NumberedEnv(TEN_STEPS_A_GAME))
    before = encode_weights(policy.network)
    stage.give(job)
    wait_until(lambda: stage.warnings, "it is told")
    assert stage.warnings == ["e: a job was not taken: they are not signed"]
    assert encode_weights(policy.network) == before
    stage.give(replace(job, signature=b"signed"))
    stage.test()
    assert encode_weights(policy.network) == WEIGHTS
    assert checked[-1] == ("test", 3, "", WEIGHTS, b"signed")
