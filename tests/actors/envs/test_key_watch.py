"""Hands whose every frame is known, timed; and the robot's own, beside the offline benchmark."""

import json
import math
from collections.abc import Iterable

import numpy as np
import pytest

from actors.envs.key_watch import KeyWatch
from actors.envs.modelled_hand import ModelledHand
from actors.envs.robot import RobotEnv
from common.actions import Keys
from common.press_latency import COUNTS, MAX_FRAMES, KeyLatency, ms_of, place_of
from common.settings.conditions import PlayConfig
from tests.paths import ROOT

NONE, UP, DOWN, FIRE = Keys.NONE, Keys.UP, Keys.DOWN, Keys.FIRE

Outcome = tuple[str, str, int]
PLACES: dict[int, Outcome] = {
    place_of(goal, reached, frames): (goal, "reached" if reached else "given up", frames)
    for goal in ("release", "press")
    for reached in (True, False)
    for frames in range(1, MAX_FRAMES + 1)
}


def told(watch: KeyWatch) -> list[Outcome]:
    return [PLACES[place] for place in watch.take()]


def give(watch: KeyWatch, keys: Keys, held: Keys) -> None:
    """A command that reaches the hands at once."""
    watch.give()
    watch.command(keys, held)


def watched(script: Iterable[tuple[Keys, list[Keys]]]) -> list[Outcome]:
    """What is measured of hands that press, after each command, what the script says."""
    watch, held = KeyWatch(), NONE
    for command, frames in script:
        give(watch, command, held)
        for held in frames:
            watch.frame(held)
    return told(watch)


def test_from_one_key_to_another() -> None:
    assert watched([(UP, [NONE, NONE, UP, UP]), (DOWN, [UP, NONE, NONE, DOWN])]) == [
        ("press", "reached", 3),
        ("release", "reached", 2),
        ("press", "reached", 4),
    ]


def test_what_was_commanded_before_is_left_out_even_if_it_reaches_the_hands_later() -> None:
    watch = KeyWatch()
    give(watch, UP, NONE)
    watch.frame(UP)
    give(watch, DOWN, UP)  # under way
    watch.give()  # not yet at the hands
    watch.frame(UP)
    watch.disregard()
    watch.frame(NONE)
    watch.frame(DOWN)
    watch.command(FIRE, DOWN)
    watch.frame(FIRE)
    assert told(watch) == []
    give(watch, UP, FIRE)
    watch.frame(NONE)
    watch.frame(UP)
    assert told(watch) == [("release", "reached", 1), ("press", "reached", 2)]
    watch.disregard()
    watch.restart()
    watch.give(5)  # by hands that wait; a new game leaves out nothing
    watch.command(DOWN, NONE)
    watch.frame(DOWN)
    assert told(watch) == [("press", "reached", 6)]


def test_only_what_has_to_change_is_measured() -> None:
    script = [(UP, [UP]), (UP | FIRE, [UP, UP | FIRE]), (FIRE, [FIRE]), (NONE, [FIRE, NONE])]
    assert watched(script) == [
        ("press", "reached", 1),
        ("press", "reached", 2),  # of fire; up was there
        ("release", "reached", 1),
        ("release", "reached", 2),
    ]
    assert watched([(NONE, [NONE] * 8)]) == []


def test_a_key_of_neither_command_delays_the_release_only() -> None:
    script = [(UP, [UP]), (DOWN, [UP | FIRE, DOWN | FIRE, DOWN])]
    assert watched(script)[1:] == [("press", "reached", 2), ("release", "reached", 3)]


def test_the_same_command_again_is_still_the_first() -> None:
    assert watched([(UP, [NONE] * 4), (UP, [NONE] * 4), (UP, [UP])]) == [("press", "reached", 9)]


def test_a_superseded_command_is_given_up_at_its_age() -> None:
    script = [(UP, [NONE] * 4), (DOWN, [NONE, DOWN]), (UP | FIRE, [DOWN] * 3), (DOWN, [DOWN])]
    assert watched(script) == [
        ("press", "given up", 4),
        ("press", "reached", 2),
        ("release", "given up", 3),
        ("press", "given up", 3),
    ]
    # Of one that no frame followed nothing is known.
    assert watched([(UP, []), (DOWN, [DOWN])]) == [("press", "reached", 1)]


def test_nobody_is_watched_for_ever() -> None:
    assert watched([(UP, [NONE] * 50 + [UP])]) == [("press", "given up", MAX_FRAMES)]
    assert watched([(UP, [NONE] * (MAX_FRAMES - 1) + [UP])]) == [("press", "reached", MAX_FRAMES)]


def test_a_command_on_its_way_is_watched_from_its_giving_and_not_given_up_for_the_next() -> None:
    watch, held = KeyWatch(), NONE
    # Given in frames 0, 4 and 8; with the hands in frames 6, 10 and 14, whose end has their keys.
    commands = [UP, NONE, UP | FIRE]
    for frame in range(16):
        if frame in (0, 4, 8):
            watch.give()
        if frame in (6, 10, 14):
            held = commands[(frame - 6) // 4]
            watch.command(held, commands[(frame - 10) // 4] if frame > 6 else NONE)
        watch.frame(held)
    assert told(watch) == [("press", "reached", 7), ("release", "reached", 7),
                           ("press", "reached", 7)]  # fmt: skip


def test_a_command_that_hands_take_step_by_step_is_timed_as_one() -> None:
    """They leave FIRE first and UP a frame later, and neither key before its time."""
    watch, both = KeyWatch(), UP | FIRE
    give(watch, both, NONE)
    watch.frame(both)
    for ago, command, felt in ((0, UP, both), (1, NONE, UP), (2, DOWN, NONE)):
        watch.give(ago)
        watch.command(command, both if ago < 2 else UP)
        watch.frame(felt)
    watch.frame(DOWN)
    assert told(watch) == [("press", "reached", 1), ("release", "reached", 3),
                           ("press", "reached", 4)]  # fmt: skip


def test_a_restart_forgets_what_is_on_its_way() -> None:
    watch = KeyWatch()
    watch.give()
    watch.frame(NONE)
    watch.restart()
    give(watch, UP, NONE)
    watch.frame(UP)
    assert told(watch) == [("press", "reached", 1)]


@pytest.mark.parametrize(
    ("waits", "outcome"),
    [(MAX_FRAMES - 1, "reached"), (MAX_FRAMES, "given up"), (MAX_FRAMES + 9, "given up")],
)
def test_a_wait_counts_as_time(waits: int, outcome: str) -> None:
    watch = KeyWatch()
    watch.give()
    for _ in range(waits):
        watch.frame(NONE)
    watch.command(UP, NONE)
    watch.frame(UP)
    assert told(watch) == [("press", outcome, MAX_FRAMES)]


def test_of_commands_that_arrive_in_one_frame_only_the_last_is_watched() -> None:
    watch = KeyWatch()
    watch.give()
    watch.give()
    watch.frame(NONE)
    watch.command(UP, NONE)
    watch.command(DOWN, NONE)
    watch.frame(DOWN)
    assert told(watch) == [("press", "reached", 2)]


def test_a_command_that_another_replaces_at_the_hands_was_not_missed() -> None:
    watch = KeyWatch()
    give(watch, FIRE, NONE)
    watch.frame(FIRE)  # a command of which a frame was seen
    for _ in range(2):
        watch.give()
        watch.frame(FIRE)
    assert told(watch) == [("press", "reached", 1)]
    watch.command(UP, FIRE)
    watch.command(DOWN, FIRE)
    watch.frame(DOWN)
    assert told(watch) == [("release", "reached", 2), ("press", "reached", 2)]


def test_the_end_of_time_gives_up_and_a_restart_forgets() -> None:
    watch = KeyWatch()
    give(watch, UP, NONE)
    watch.frame(NONE)
    watch.give_up()
    watch.give_up()
    assert told(watch) == [("press", "given up", 1)]
    give(watch, DOWN, NONE)
    watch.frame(NONE)
    watch.restart()
    give(watch, UP, NONE)
    watch.frame(UP)
    assert told(watch) == [("press", "reached", 1)]
    assert told(watch) == []


def test_who_never_asks_costs_no_more_memory() -> None:
    watch = KeyWatch()
    for _ in range(2_000):
        for keys in (UP, NONE):
            give(watch, keys, UP ^ keys)
            watch.frame(keys)
    assert len(watch.take()) == 1_024


def test_a_modelled_hand_takes_the_frames_that_it_is_told_and_presses_in_the_next() -> None:
    hand, watch = ModelledHand(PlayConfig(press_latency=3)), KeyWatch()
    for command in (UP, DOWN, FIRE):
        give(watch, command, hand.held)
        hand.command(command)
        for _ in range(4):
            watch.frame(hand.step_frame())
    assert told(watch) == [
        ("press", "reached", 4),
        *[("release", "reached", 1), ("press", "reached", 4)] * 2,
    ]


def delays(env: RobotEnv, steps: int, seed: int) -> tuple[KeyLatency, KeyLatency]:
    """Release and press of random play."""
    env.reset(seed=seed)
    rng = np.random.default_rng(seed)
    counts = [0] * COUNTS
    for _ in range(steps):
        *_, terminated, truncated, info = env.step(rng.integers(env.action_space.n))  # type: ignore[attr-defined]
        for place in info["key_times"]:
            counts[place] += 1
        if terminated or truncated:
            env.reset()
    env.close()
    return KeyLatency.of(counts, "release"), KeyLatency.of(counts, "press")


@pytest.mark.parametrize("read_keys", ["frame", "decision"])
def test_the_robot_is_as_prompt_in_play_as_its_benchmark_says(read_keys: str) -> None:
    """Whenever the controller is read: it is the hands that are timed."""
    results = ROOT / "benchmarks" / "results" / "press_latency.json"
    benchmark = json.loads(results.read_text())
    play = PlayConfig(read_keys=read_keys, eye="emulator")  # type: ignore[arg-type]
    release, press = delays(RobotEnv(play=play), 400, 5)
    assert press.measured > 250
    assert press.p50 == pytest.approx(benchmark["p50_ms"], abs=ms_of(1))
    assert press.p99 == pytest.approx(benchmark["p99_ms"], abs=ms_of(1))
    assert press.p50 is not None
    assert release.p50 is not None
    assert ms_of(1) <= release.p50 < press.p50


def test_commands_that_are_replaced_before_their_keys_come_count_as_slow() -> None:
    """Pong's own keys come after two or three frames, and two are all that most commands have."""
    play = PlayConfig(frame_skip=2, minimal_actions=True, eye="emulator")
    _, press = delays(RobotEnv(play=play), 300, 1)
    assert press.measured > 100
    assert press.given_up is not None
    assert 0.5 < press.given_up < 1
    assert press.p50 == press.p99 == math.inf


@pytest.mark.parametrize("late", [{"actuation_latency": 12}, {"equal_latency": 12}])
def test_commands_that_come_late_on_purpose_are_timed_with_their_wait(late: dict[str, int]) -> None:
    """A new one is given every four frames, before any of them is carried out."""
    play = PlayConfig(hand="model", press_latency=3, eye="emulator", **late)  # type: ignore[arg-type]
    release, press = delays(RobotEnv(play=play), 100, 2)
    assert release.measured > 40
    assert press.measured > 40
    assert (release.p50, press.p50) == (ms_of(13), ms_of(16))
    assert press.given_up is not None
    assert press.given_up < 0.05


def test_a_robots_modelled_hand_is_timed_as_well() -> None:
    play = PlayConfig(hand="model", press_latency=3, eye="emulator")
    release, press = delays(RobotEnv(play=play), 60, 2)
    assert (release.p50, release.p99) == (ms_of(1), ms_of(1))
    assert (press.p50, press.p99) == (ms_of(4), ms_of(4))


def test_an_episode_ends_with_all_told_and_a_new_game_begins_with_nothing() -> None:
    play = PlayConfig(
        hand="model", press_latency=9, eye="emulator", random_starts=0, max_game_frames=4 * 3
    )
    env = RobotEnv(play=play)
    env.reset(seed=1)
    found = [env.step(2)[4]["key_times"] for _ in range(3)]
    assert [PLACES[place] for told in found for place in told] == [("press", "reached", 10)]
    env.reset()
    found = [env.step(action)[4]["key_times"] for action in (0, 0, 2)]
    assert [PLACES[place] for told in found for place in told] == [("press", "given up", 4)]
    _, info = env.reset()
    assert info["key_times"] == ()
    assert env.step(0)[4]["key_times"] == ()
    env.close()
