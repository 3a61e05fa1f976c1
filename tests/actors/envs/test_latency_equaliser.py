"""One latency for all hands: against hands that have that latency by themselves."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.envs.late_commands import hands_of
from actors.envs.latency_equaliser import LatencyEqualiser
from actors.envs.robot import RobotEnv
from actors.robots.interface import Hands
from common.actions import KEYS_OF_ACTION, Keys
from common.run.conditions import PlayConfig

EQUAL = 12
WARM_UP = [2, 0, 5, 3, 0, 4] * 2
ACTIONS = st.lists(st.integers(0, 17), min_size=1, max_size=30)


def hands(latency: int = 0, press: int = 0, equal: int = 0) -> Hands:
    play = PlayConfig(actuation_latency=latency, press_latency=press)
    made = hands_of(play, None, np.random.default_rng(0))
    if equal:
        made = LatencyEqualiser(made, equal)
    made.rest()
    return made


def play(on: Hands, actions: list[int], frames: int = 4) -> list[Keys]:
    """The keys of each frame, with a command every ``frames``."""
    felt = []
    for action in actions:
        on.command(KEYS_OF_ACTION[action])
        felt += [on.step_frame() for _ in range(frames)]
    return felt


def first_press(on: Hands, keys: Keys = Keys.FIRE) -> int:
    """Frames from a command to its keys, of hands at rest."""
    on.command(keys)
    return next(frame for frame in range(60) if on.step_frame() & keys)


@given(st.integers(0, EQUAL), st.integers(0, 3), ACTIONS)
def test_quick_hands_do_what_slow_ones_do(latency: int, press: int, actions: list[int]) -> None:
    quick, slow = hands(latency, press, equal=EQUAL), hands(EQUAL, press)
    for on in (quick, slow):
        play(on, WARM_UP, 40)
    assert play(quick, actions) == play(slow, actions)


@given(st.integers(EQUAL, 36), ACTIONS)
def test_slower_hands_are_not_made_slower(latency: int, actions: list[int]) -> None:
    waiting, own = hands(latency, equal=EQUAL), hands(latency)
    for on in (waiting, own):
        play(on, WARM_UP, 40)
    assert play(waiting, actions) == play(own, actions)


def test_commands_go_on_at_once_until_the_hands_are_known() -> None:
    equal = hands(latency=3, equal=EQUAL)
    assert first_press(equal) == 3
    equal.command(Keys.NONE)
    assert [bool(equal.step_frame()) for _ in range(14)] == [True] * EQUAL + [False] * 2


def test_other_hands_are_not_known() -> None:
    equal = hands(latency=3, equal=EQUAL)
    play(equal, WARM_UP, 40)
    equal.rest()
    assert [equal.step_frame() for _ in range(20)] == [Keys.NONE] * 20
    assert first_press(equal) == 3


def test_what_waits_is_forgotten_with_the_game() -> None:
    equal = hands(equal=EQUAL)
    play(equal, WARM_UP, 40)
    equal.command(Keys.FIRE)
    equal.step_frame()
    equal.rest()
    assert not any(equal.step_frame() for _ in range(30))


def test_hands_that_become_slower_are_found_out() -> None:
    class Changing:
        """Hands that others take over."""

        def __init__(self) -> None:
            self.now = hands(latency=1)

        @property
        def held(self) -> Keys:
            return self.now.held

        def rest(self) -> None:
            self.now.rest()

        def command(self, keys: Keys) -> None:
            self.now.command(keys)

        def step_frame(self) -> Keys:
            return self.now.step_frame()

    changing = Changing()
    equal, slow = LatencyEqualiser(changing, EQUAL), hands(EQUAL)
    equal.rest()
    for on in (equal, slow):
        play(on, WARM_UP, 40)
    changing.now = hands(latency=7)
    changing.command(KEYS_OF_ACTION[WARM_UP[-1]])
    for on in (equal, slow):
        play(on, WARM_UP * 2, 40)
    assert play(equal, [1, 0, 2], 20) == play(slow, [1, 0, 2], 20)


@pytest.mark.parametrize("robot", ["nao", "robotroller"])
def test_the_arms_of_a_robot_are_as_slow_as_asked(robot: str) -> None:
    def felt(latency: int, equal: int) -> list[np.ndarray]:
        env = RobotEnv(
            play=PlayConfig(
                robot=robot,
                actuation_latency=latency,
                equal_latency=equal,
                vector=True,
                random_starts=0,
            )
        )
        env.reset(seed=1)
        rng, keys = np.random.default_rng(2), []
        for step in range(100):
            if step % 5 == 0:
                action = rng.integers(18)
            observation, *_ = env.step(action)
            assert isinstance(observation, dict)
            keys += list(observation["vector"][108:128].reshape(4, 5))
        env.close()
        return keys[160:]

    slow = felt(EQUAL, 0)
    equal, unequal = felt(5, EQUAL), felt(5, 0)
    assert np.mean([(a == b).all() for a, b in zip(equal, slow, strict=True)]) > 0.97
    assert np.mean([(a == b).all() for a, b in zip(unequal, slow, strict=True)]) < 0.8
