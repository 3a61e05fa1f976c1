import pytest

from common.settings.config import LearningConfig, ReplayConfig, RunConfig
from replay.limiter import RateLimiter


@pytest.fixture
def limiter() -> RateLimiter:
    return RateLimiter(samples_per_insert=8.0, learning_starts=100, tolerance=10, batch_size=32)


def test_a_run_has_the_limiter_of_its_settings() -> None:
    config = RunConfig(
        replay=ReplayConfig(learning_starts=500, ratio_tolerance=300),
        learning=LearningConfig(batch_size=16, train_period=8),
    )
    assert RateLimiter.of(config) == RateLimiter(2.0, 500, 300, 16)


@pytest.mark.parametrize(
    ("inserted", "drawn", "deficit"),
    [(100, 0, 0.0), (104, 32, 0.0), (110, 0, 80.0), (100, 64, -64.0), (0, 0, -800.0)],
)
def test_the_deficit_is_what_the_ratio_owes(
    limiter: RateLimiter, inserted: int, drawn: int, deficit: float
) -> None:
    assert limiter.deficit(inserted, drawn) == deficit


def test_nothing_is_drawn_before_the_warm_up_is_whole(limiter: RateLimiter) -> None:
    assert not limiter.may_sample(99, 0)
    assert limiter.may_sample(100, 0)


def test_the_learner_may_run_ahead_by_the_tolerance(limiter: RateLimiter) -> None:
    # 10 steps are 80 draws: two batches of 32, not three.
    assert limiter.may_sample(100, 32)
    assert not limiter.may_sample(100, 64)
    assert not limiter.may_sample(101, 64)
    assert limiter.may_sample(102, 64)


def test_actors_are_held_beyond_the_tolerance(limiter: RateLimiter) -> None:
    assert not limiter.should_throttle(110, 0)
    assert limiter.should_throttle(111, 0)
    assert not limiter.should_throttle(111, 8)
    assert not limiter.should_throttle(0, 0)


def test_there_is_no_state_in_which_both_wait() -> None:
    limiter = RateLimiter(samples_per_insert=8.0, learning_starts=10, tolerance=4, batch_size=32)
    for inserted in range(10, 60):
        for drawn in range(0, 500, 4):
            assert limiter.may_sample(inserted, drawn) or not limiter.should_throttle(
                inserted, drawn
            )
