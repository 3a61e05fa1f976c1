"""Added latency: when a command reaches the hands, by hand-written sequences and on the arms."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.envs.ale import AtariEnv
from actors.envs.hands import hands_of
from actors.envs.late_commands import LateCommands
from actors.envs.robot import RobotEnv
from actors.robots.interface import Hands
from actors.robots.nao.robot import Nao
from common.actions import KEYS_OF_ACTION, Keys
from common.settings.conditions import PlayConfig

NONE, UP, DOWN, FIRE = Keys.NONE, Keys.UP, Keys.DOWN, Keys.FIRE


class PromptHands:
    """Hold what they were told last, and remember when they were told."""

    def __init__(self) -> None:
        self.held = NONE
        self.frame = 0
        self.told: list[tuple[int, Keys]] = []

    def rest(self) -> None:
        self.held = NONE

    def command(self, keys: Keys) -> None:
        self.told.append((self.frame, keys))
        self.held = keys

    def step_frame(self) -> Keys:
        self.frame += 1
        return self.held


def late(hands: Hands, latency: int, jitter: int = 0, seed: int = 0) -> LateCommands:
    return LateCommands(hands, latency, jitter, np.random.default_rng(seed))


def pressed_after(hands: Hands, keys: Keys, frames: int = 60) -> list[Keys]:
    """What is pressed frame by frame from the command for ``keys`` on."""
    hands.command(keys)
    return [hands.step_frame() for _ in range(frames)]


@pytest.mark.parametrize("latency", [0, 1, 5, 36])
def test_a_command_arrives_after_its_latency(latency: int) -> None:
    hands = late(PromptHands(), latency)
    assert pressed_after(hands, UP, latency + 2) == [NONE] * latency + [UP] * 2


def test_a_command_waits_for_an_earlier_one_that_is_later() -> None:
    """Neither overtakes the other, nor is the earlier one sooner for it."""
    lateness = iter([5, 0])
    rng: Any = SimpleNamespace(integers=lambda _: next(lateness))
    prompt = PromptHands()
    hands = LateCommands(prompt, 2, 5, rng)
    for keys in (UP, DOWN):
        hands.command(keys)
        hands.step_frame()
    for _ in range(9):
        hands.step_frame()
    assert prompt.told == [(7, UP), (7, DOWN)]


def test_commands_follow_one_another_at_the_pace_at_which_they_were_given() -> None:
    hands = late(PromptHands(), 6)
    found = [keys for command in (UP, DOWN, FIRE) for keys in pressed_after(hands, command, 4)]
    assert found == [NONE] * 6 + [UP] * 4 + [DOWN] * 2


def test_hands_at_rest_have_no_command_on_its_way() -> None:
    hands = late(PromptHands(), 3)
    pressed_after(hands, UP, 2)
    hands.rest()
    assert pressed_after(hands, NONE, 12) == [NONE] * 12


@given(
    latency=st.integers(0, 12),
    jitter=st.integers(1, 12),
    pauses=st.lists(st.integers(0, 6), min_size=1, max_size=30),
    seed=st.integers(0, 1_000),
)
def test_jitter_only_adds_up_to_its_bound_and_keeps_the_order(
    latency: int, jitter: int, pauses: list[int], seed: int
) -> None:
    prompt = PromptHands()
    hands = late(prompt, latency, jitter, seed)
    given_at, commands = [], []
    for number, pause in enumerate(pauses):
        commands.append(KEYS_OF_ACTION[number % 18])
        given_at.append(prompt.frame)
        hands.command(commands[-1])
        for _ in range(pause):
            hands.step_frame()
    for _ in range(latency + jitter + 1):
        hands.step_frame()
    assert [keys for _, keys in prompt.told] == commands
    lateness = np.array([frame for frame, _ in prompt.told]) - given_at
    assert (lateness >= latency).all()
    # One that waits for an earlier one is no later than that one may be.
    assert (lateness <= latency + jitter).all()


@pytest.mark.parametrize("latency", [0, 2])
def test_jitter_is_drawn_for_each_command_uniformly(latency: int) -> None:
    prompt = PromptHands()
    play = PlayConfig(actuation_latency=latency, actuation_jitter=3)
    hands = hands_of(play, prompt, np.random.default_rng(0))
    for number in range(2_000):
        pressed_after(hands, KEYS_OF_ACTION[number % 18], 8)
    lateness = np.array([frame - 8 * number for number, (frame, _) in enumerate(prompt.told)])
    _, counts = np.unique(lateness, return_counts=True)
    assert set(lateness - latency) == {0, 1, 2, 3}
    assert counts / len(lateness) == pytest.approx(0.25, abs=0.04)


@pytest.mark.parametrize("keys", [UP, FIRE, DOWN | FIRE])
@pytest.mark.parametrize("latency", [2, 4, 12, 36])
def test_the_arms_press_and_release_later_by_exactly_the_latency(
    room: Nao, latency: int, keys: Keys
) -> None:
    """The step response, up and down, is that of prompt arms, shifted."""

    def response(hands: Hands) -> list[Keys]:
        hands.rest()
        return pressed_after(hands, keys) + pressed_after(hands, NONE)

    prompt = response(room)
    assert keys in prompt
    delayed = response(
        hands_of(PlayConfig(actuation_latency=latency), room, np.random.default_rng())
    )
    first, last = prompt.index(keys), 119 - prompt[::-1].index(keys)
    assert (first, last) != (0, 119)
    assert delayed.index(keys) == first + latency
    assert 119 - delayed[::-1].index(keys) == last + latency
    assert delayed[latency:] == prompt[: 120 - latency]


def test_slow_arms_take_longer_from_key_to_key(room: Nao) -> None:
    slow = Nao(play=PlayConfig(arm_speed=0.25))

    def crossing(hands: Hands) -> int:
        hands.rest()
        pressed_after(hands, UP)
        return pressed_after(hands, DOWN).index(DOWN)

    assert crossing(room) + 2 <= crossing(slow) <= 12

    def firing(hands: Hands) -> int:
        hands.rest()
        return pressed_after(hands, FIRE).index(FIRE)

    assert firing(room) < firing(slow) <= 4  # the right arm, too
    slow.close()


def test_keys_that_need_a_deeper_push_are_pressed_later_and_released_earlier() -> None:
    frames = {}
    for threshold in (0.5, 1.4):
        room = Nao(play=PlayConfig(key_threshold=threshold))
        pressed = pressed_after(room, FIRE).index(FIRE)
        frames[threshold] = pressed, pressed_after(room, NONE).index(NONE)
        room.close()
    assert frames[0.5][0] < frames[1.4][0]
    assert frames[0.5][1] >= frames[1.4][1]


def test_without_latency_the_hands_are_the_arms_themselves(room: Nao) -> None:
    rng = np.random.default_rng(1)
    assert hands_of(PlayConfig(press_latency=3), room, rng) is room  # that of the model only
    assert rng.random() == np.random.default_rng(1).random()


def test_the_emulator_hears_of_a_late_command_when_its_time_has_come() -> None:
    """An agent step and a half later: in the middle of the second one."""
    pong = PlayConfig(random_starts=0, vector=True)
    env = AtariEnv("pong", play=replace(pong, actuation_latency=6))
    env.reset(seed=1)
    felt = []
    for action in (2, 5, 5):
        observation, *_, info = env.step(action)
        assert isinstance(observation, dict)
        felt.append(observation["vector"][108:128].reshape(4, 5)[:, :2].tolist())
        assert info["keys_match"] == (len(felt) == 3)
    none, up, down = [0, 0], [1, 0], [0, 1]
    assert felt == [[none] * 4, [none, none, up, up], [up, up, down, down]]


@pytest.mark.parametrize("hand", ["arm", "model"])
def test_seeded_games_of_jittering_hands_repeat(hand: str) -> None:
    play = PlayConfig(
        eye="emulator",
        actuation_latency=2,
        actuation_jitter=4,
        vector=True,
        vector_joints=False,
        random_starts=0,  # so that games differ by their jitter alone
    )
    env = RobotEnv("pong", play=replace(play, hand=hand))  # type: ignore[arg-type]

    def game(seed: int) -> list[bytes]:
        env.reset(seed=seed)
        return [env.step(action)[0]["vector"].tobytes() for action in (2, 5) * 15]  # type: ignore

    first, other = game(3), game(4)
    assert game(3) == first != other
    env.close()
