"""The forecast of keys, against hands that are let go on without a new command."""

from copy import deepcopy

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from actors.envs.ale import AtariEnv
from actors.envs.hands import hands_of
from actors.envs.key_forecast import LONGEST, KeyForecast
from actors.envs.proprioception import Proprioception
from actors.envs.robot import RobotEnv
from common.actions import KEYS_OF_ACTION, Keys
from common.settings.conditions import PlayConfig

FRAMES = 24
ACTIONS = st.lists(st.integers(0, 17), min_size=1, max_size=6)


class Watched:
    """Hands and their forecast, as an environment moves them."""

    def __init__(self, play: PlayConfig) -> None:
        self.hands = hands_of(play, None, np.random.default_rng(0))
        self.hands.rest()
        self.forecast = KeyForecast(FRAMES)

    def step(self, action: int) -> None:
        self.hands.command(KEYS_OF_ACTION[action])
        self.forecast.command(KEYS_OF_ACTION[action])
        for _ in range(4):
            self.forecast.feel(self.hands.step_frame())

    def warm_up(self) -> None:
        """Keys that are held long enough for any hands."""
        for action in (2, 0, 5, 3, 0, 4):
            for _ in range(12):
                self.step(action)

    def rest_of(self, keys: Keys | None = None) -> list[Keys]:
        """The keys of the next frames; after another command, if one is given."""
        hands = deepcopy(self.hands)
        if keys is not None:
            hands.command(keys)
        return [hands.step_frame() for _ in range(FRAMES)]

    def told(self) -> list[Keys]:
        order = (Keys.UP, Keys.DOWN, Keys.LEFT, Keys.RIGHT, Keys.FIRE)
        rows = self.forecast.rows()[:, 2:].astype(bool)
        return [
            sum((key for key, held in zip(order, row, strict=True) if held), Keys.NONE)
            for row in rows
        ]


@given(st.integers(0, 16), st.integers(0, 6), ACTIONS)
def test_it_tells_the_keys_that_come_if_the_last_command_is_kept(
    latency: int, press: int, actions: list[int]
) -> None:
    watched = Watched(PlayConfig(actuation_latency=latency, press_latency=press))
    watched.warm_up()
    for action in actions:
        for _ in range(2):  # the press of a shorter command is not sure to come
            watched.step(action)
    assert watched.told() == watched.rest_of()


@given(st.integers(0, 16), st.integers(0, 6))
def test_it_tells_from_which_frame_on_the_next_command_matters(latency: int, press: int) -> None:
    watched = Watched(PlayConfig(actuation_latency=latency, press_latency=press))
    watched.warm_up()
    held = watched.told()[-1]
    other = Keys.FIRE if held != Keys.FIRE else Keys.UP
    coming = watched.rest_of(other)
    too_late = watched.forecast.rows()[:, :2].astype(bool)
    assert [bool(held & keys) for keys in coming] == too_late[:, 0].tolist()
    assert [other not in keys for keys in coming] == too_late[:, 1].tolist()


def test_nothing_is_known_of_other_hands() -> None:
    watched = Watched(PlayConfig(actuation_latency=9))
    watched.warm_up()
    assert watched.forecast.rows()[:, :2].sum() == 18
    watched.forecast.restart()
    assert not watched.forecast.rows().any()
    watched.forecast.command(Keys.UP)
    assert watched.told() == [Keys.UP] * FRAMES  # at once, for all that is known


def test_a_change_of_many_causes_is_told_by_those_before_it() -> None:
    # Up is asked for every second step, so each press may come of this command or of one before.
    watched = Watched(PlayConfig(actuation_latency=3))
    watched.step(2)
    watched.step(2)
    for _ in range(8):
        watched.step(0)
        watched.step(2)
    assert watched.forecast.rows()[:, :2].sum(axis=0).tolist() == [3, 3]


def test_hands_that_became_slower_are_found_out() -> None:
    watched = Watched(PlayConfig(actuation_latency=2))
    watched.warm_up()
    watched.hands = hands_of(PlayConfig(actuation_latency=11), None, np.random.default_rng(0))
    watched.hands.command(KEYS_OF_ACTION[4])
    for _ in range(3):
        watched.warm_up()
    assert watched.forecast.rows()[:, :2].sum(axis=0).tolist() == [11, 11]


def test_a_latency_beyond_the_longest_is_not_found() -> None:
    forecast = KeyForecast(FRAMES)
    forecast.command(Keys.UP)
    for _ in range(LONGEST + 5):
        forecast.feel(Keys.NONE)
    forecast.feel(Keys.UP)
    assert forecast.rows()[:, :2].sum() == 0


def test_it_comes_last_in_the_vector_and_is_forgotten_with_it() -> None:
    play = PlayConfig(vector=True, vector_forecast=FRAMES)
    sense, forecast = Proprioception(play, joints=3), KeyForecast(FRAMES)
    for action in (5, 2, 2, 2):
        sense.command(action)
        forecast.command(KEYS_OF_ACTION[action])
        for _ in range(4):
            sense.feel(KEYS_OF_ACTION[action] if action != 2 else Keys.NONE)
            forecast.feel(KEYS_OF_ACTION[action] if action != 2 else Keys.NONE)
    vector = sense.vector(np.ones(3), np.zeros(3))
    assert vector.shape == (128 + 6 + FRAMES * 7,)
    assert vector[128:134].tolist() == [1, 1, 1, 0, 0, 0]
    assert vector[134:].tolist() == forecast.rows().ravel().tolist()
    assert vector[134:].any()
    sense.forget()
    assert not sense.vector().any()


def test_the_emulators_hands_show_their_latency_in_each_frame() -> None:
    play = PlayConfig(vector=True, vector_forecast=FRAMES, random_starts=0, actuation_latency=6)
    env = AtariEnv(play=play)
    env.reset(seed=1)
    for action in (2, 2, 2, 0, 0, 0):
        observation, *_ = env.step(action)
    assert isinstance(observation, dict)
    forecast = observation["vector"][-FRAMES * 7 :].reshape(FRAMES, 7)
    assert forecast[:, :2].sum(axis=0).tolist() == [6, 6]


def test_the_robots_keys_come_as_forecast() -> None:
    play = PlayConfig(vector=True, vector_forecast=FRAMES, actuation_latency=6, random_starts=0)
    env = RobotEnv(play=play)
    rng = np.random.default_rng(4)
    observation, _ = env.reset(seed=1)
    told: list[np.ndarray] = []
    felt: list[np.ndarray] = []
    for step in range(120):
        if step % 3 == 0:
            action = rng.integers(18)
        observation, *_ = env.step(action)
        assert isinstance(observation, dict)
        told.append(observation["vector"][-FRAMES * 7 :].reshape(FRAMES, 7))
        felt += list(observation["vector"][108:128].reshape(4, 5))
    env.close()
    sure = np.array(
        [
            (felt[4 * (step + 1) + ahead] == row[2:]).all()
            for step, rows in enumerate(told[:-2])
            if step >= 20
            for ahead, row in enumerate(rows[:6])
            if row[0]
        ]
    )
    assert len(sure) == 98 * 6
    # Arms need a frame more for some keys than for others.
    assert sure.mean() > 0.9


def test_hands_that_become_slower_are_followed_after_some_changes() -> None:
    """However many there were before: some ten changes count."""
    forecast, told = KeyForecast(FRAMES), [Keys.NONE] * 9
    for latency, presses in ((5, 40), (9, 8)):
        for keys in [Keys.UP, Keys.NONE] * presses:
            for _ in range(20):
                forecast.command(keys)
                told.append(keys)
                forecast.feel(told[-1 - latency])
        assert (forecast._press.frames, forecast._release.frames) == (latency, latency)
