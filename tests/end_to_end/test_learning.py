"""The whole pipeline learns: Catch through actors, Zenoh, replay, Double DQN and back."""

from benchmarks import catch
from tests.end_to_end.conftest import Stage


def test_it_learns_to_catch(stage: Stage) -> None:
    catch.install(stage.folder)
    learner = stage.learner(
        "--env", "catch",
        "--threads", "1",
        "--steps", "9000",
        "--replay.learning-starts", "1000",
        "--replay.capacity", "20000",
        "--replay.ratio-tolerance", "256",
        "--learning.network", "nips",
        "--learning.batch-size", "32",
        "--learning.train-period", "2",
        "--learning.learning-rate", "0.002",
        "--learning.n-step", "1",
        "--learning.discount", "0.9",
        "--learning.target-update-period", "100",
        "--learning.publish-period", "20",
        "--exploration.end", "0.1",
        "--exploration.steps", "3000",
        "--protocol.epoch-steps", "8000",
        "--protocol.test-steps", "1200",
        "--protocol.test-epsilon", "0",
        "--protocol.held-out-states", "64",
    )  # fmt: skip
    stage.actor("a")
    stage.actor("e", "--evaluator")

    learner.ends()

    rows = stage.rows()
    random, last = rows[0], rows[-1]
    assert (random["phase"], last["phase"]) == ("random", "test")
    # 166 random games: the mean's standard error is 0.07.
    assert abs(float(random["average_reward"]) - catch.RANDOM_SCORE) < 0.3
    # 200 games without exploration: chance would miss nearly 4 of 5.
    assert int(last["nr_games"]) >= 190
    assert float(last["average_reward"]) >= 0.8
