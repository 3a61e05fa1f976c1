"""What hands can do under the settings of play."""

from dataclasses import replace

import pytest

from common.settings.conditions import PlayConfig
from common.settings.hands import keys_can_follow, latest_play
from common.settings.presets import PRESETS


@pytest.mark.parametrize(
    ("play", "can"),
    [
        (PlayConfig(), True),
        (PlayConfig(read_keys="decision"), False),
        (PlayConfig(frame_skip=3), False),  # an arm takes four frames at times
        (PlayConfig(hand="model", press_latency=3), True),
        (PlayConfig(hand="model", press_latency=4), False),  # in the fifth frame
        (PlayConfig(actuation_latency=1), False),
        (PlayConfig(actuation_jitter=1), False),
        (PlayConfig(equal_latency=1), False),
        (PlayConfig(arm_speed=0.6, key_threshold=1.3), True),
        (PlayConfig(robot="hand.npz"), False),
    ],
)
def test_where_keys_can_follow_within_their_agent_step(play: PlayConfig, can: bool) -> None:
    assert keys_can_follow(play) is can


def test_the_emulator_alone_has_modelled_hands() -> None:
    slow = PlayConfig(press_latency=8)  # twice an agent step
    ale, robot = (replace(PRESETS[name], play=slow) for name in ("fast", "robot"))
    assert not keys_can_follow(latest_play(ale))
    assert keys_can_follow(latest_play(robot))  # whose arms do not have that latency


@pytest.mark.parametrize("robot", ["robotroller", "gone"])
def test_a_robot_that_does_not_play_says_nothing_of_the_emulators_hands(robot: str) -> None:
    """Nor need it be known: its package may be missing here."""
    play = PlayConfig(robot=robot)
    ale, played = (replace(PRESETS[name], play=play) for name in ("fast", "robot"))
    assert keys_can_follow(latest_play(ale))
    assert latest_play(played).robot == robot


def test_a_latency_model_is_late_without_a_body_too() -> None:
    ale = replace(PRESETS["fast"], play=PlayConfig(robot="hand.npz"))
    assert not keys_can_follow(latest_play(ale))
