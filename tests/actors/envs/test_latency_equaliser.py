"""One latency for all hands, against a schedule written down key by key."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from actors.envs.hand_timing import HandLatency
from actors.envs.hands import hands_of
from actors.envs.latency_equaliser import LatencyEqualiser
from actors.envs.robot import RobotEnv
from actors.robots.interface import Hands
from common.actions import KEYS_OF_ACTION, Keys
from common.settings.conditions import MAX_ADDED, MAX_GAP, PlayConfig
from tests.actors.envs.uneven_hands import UnevenHands

EQUAL = 12
ALL = Keys(31)
ACTIONS = st.lists(st.integers(0, 17), min_size=1, max_size=30)
DIRECTIONS = st.lists(st.sampled_from([0, *range(2, 10)]), min_size=1, max_size=30)
"""Without FIRE: the modelled hand presses all its keys anew with each command."""


def hands(latency: int = 0, press: int = 0) -> Hands:
    play = PlayConfig(actuation_latency=latency, press_latency=press)
    return hands_of(play, None, np.random.default_rng(0))


def equal(latency: int = 0, press: int = 0, at: int = EQUAL, gap: int = 0) -> LatencyEqualiser:
    made = LatencyEqualiser(hands(latency, press), at, gap)
    made.time(ALL)
    made.rest()
    return made


def play(on: Hands, actions: list[int], frames: int = 4) -> list[Keys]:
    """The keys of each frame, with a command every ``frames``."""
    felt = []
    for action in actions:
        on.command(KEYS_OF_ACTION[action])
        felt += [on.step_frame() for _ in range(frames)]
    return felt


def schedule(actions: list[int], latency: int, frames: int = 4, gap: int = 0) -> list[Keys]:
    """The keys of each frame, by a walk of each hand from one set of keys to the next: it leaves
    one at ``latency`` frames after the command, and is at the next ``gap`` frames later; if that is
    0 a frame later if it held none for six frames before, else two."""
    told = [Keys.NONE] * latency + [KEYS_OF_ACTION[each] for each in actions for _ in range(frames)]
    held = [Keys.NONE] * len(actions) * frames
    for hand in (Keys.UP | Keys.DOWN | Keys.LEFT | Keys.RIGHT, Keys.FIRE):
        at, idle, arrives = Keys.NONE, 100, 0
        for now in range(len(held)):
            if (goal := told[now] & hand) != at:
                arrives = now + (gap or (1 if not at and idle >= 6 else 2))
                at = goal
            idle = 0 if at else idle + 1
            if now >= arrives:
                held[now] |= at
    return held


@given(st.integers(0, EQUAL), ACTIONS, st.integers(4, 7))
@example(0, [2, 0, 4, 3], 4)
@example(EQUAL, [3, 4, 0, 4, 0, 0, 4, 10, 12, 1, 0, 1], 4)
@example(0, [4, 0, 4], 5)
@example(0, [4, 0, 4], 6)
def test_quick_hands_hold_the_keys_of_the_schedule(
    latency: int, actions: list[int], frames: int
) -> None:
    assert play(equal(latency), actions, frames) == schedule(actions, EQUAL, frames)


@given(st.integers(1, MAX_GAP), st.integers(0, EQUAL), ACTIONS, st.integers(4, 7))
@example(4, EQUAL, [3, 4, 0, 4, 0, 0, 4, 10, 12, 1, 0, 1], 4)
@example(MAX_GAP, 0, [3, 3, 3, 4, 4, 4, 4, 0, 3, 3, 3, 3], 4)
def test_the_gap_is_as_long_as_wished(
    gap: int, latency: int, actions: list[int], frames: int
) -> None:
    waiting = equal(latency, gap=gap)
    assert play(waiting, actions, frames) == schedule(actions, EQUAL, frames, gap)


def test_a_gap_by_hand() -> None:
    left, right, none = Keys.LEFT, Keys.RIGHT, Keys.NONE
    # left, right, left for one agent step, right.
    felt = play(equal(at=1, gap=4), [4, 4, 3, 3, 3, 4, 3, 3, 3])[1:]
    assert felt[:12] == [*[none] * 4, *[left] * 4, *[none] * 4]
    assert felt[12:24] == [*[right] * 8, *[none] * 4]
    assert felt[24:] == [*[none] * 4, *[right] * 7]


@given(st.integers(0, EQUAL), DIRECTIONS)
@example(EQUAL, [3, 4, 0, 4, 0, 0, 4])
def test_a_hand_that_presses_a_frame_later_does_so_too(latency: int, actions: list[int]) -> None:
    assert play(equal(latency, press=1), actions) == schedule(actions, EQUAL)


@given(st.integers(EQUAL + 2, 36), st.integers(0, 3), ACTIONS)
def test_slow_hands_are_left_alone(latency: int, press: int, actions: list[int]) -> None:
    assert play(equal(latency, press), actions) == play(hands(latency, press), actions)


@pytest.mark.parametrize("latency", [0, 3])
def test_commands_are_remembered_for_the_longest_latency(latency: int) -> None:
    actions = [2, 0, 4, 3, 1, 1, 0, 0, 10, 5] * 3
    waiting = equal(latency, at=MAX_ADDED)
    assert play(waiting, actions) == schedule(actions, MAX_ADDED)


def test_the_schedule_by_hand() -> None:
    left, fire, none = Keys.LEFT, Keys.FIRE, Keys.NONE
    # left, then left with fire, right, nothing for one agent step, right.
    felt = play(equal(), [4, 12, 3, 0, 3, 0, 0, 0])[EQUAL:]
    assert felt[:8] == [none, left, left, left, left, left | fire, left | fire, left | fire]
    assert felt[8:16] == [none, none, *[Keys.RIGHT] * 2, *[none] * 4]
    assert felt[16:] == [none, none, *[Keys.RIGHT] * 2][: len(felt) - 16]


@given(st.integers(3, 6), st.lists(st.sampled_from([0, 2, 3, 4, 5]), min_size=1, max_size=30))
@example(5, [2, 0, 4, 3])
def test_hands_that_are_slow_to_press_release_in_time(press: int, actions: list[int]) -> None:
    """Whoever pressed one key sooner would release the one before it sooner too."""
    felt, due = play(equal(0, press), actions, 8), schedule(actions, EQUAL, 8)
    assert not any(keys & ~wanted for keys, wanted in zip(felt, due, strict=True))
    last = [now for now in range(len(due) - 1) if due[now] and due[now] != due[now + 1]]
    assert [felt[now] for now in last] == [due[now] for now in last]


def test_a_slow_press_begins_no_sooner_than_the_keys_before_it_may_be_left() -> None:
    """After a rest that is a frame before it is due, and in play two."""
    assert equal(2, press=5)._keys_by_latency == {HandLatency(2, 2 + 1, 2 + 2): int(ALL)}


@pytest.mark.parametrize("latency", [EQUAL, MAX_ADDED])
@pytest.mark.parametrize(
    ("release", "press", "seen_late", "turns"),
    [
        (0, 0, 0, [11, 11]),  # neither, DOWN
        (3, 3, 0, [11, 11]),
        (5, 6, 0, [11]),
        (0, 0, 4, [11, 11]),
        (2, 5, 0, [11]),  # hands that press so slowly set out for DOWN before they may leave UP
        (2, 5, 4, [11]),
    ],
)
def test_a_command_that_waited_is_timed_from_when_it_was_given(
    latency: int, release: int, press: int, seen_late: int, turns: list[int]
) -> None:
    """A press counts from the first command of its key, a release from the first without it,
    however soon the hands have to set out for it."""
    moments: list[int] = []
    frame = 0
    own = UnevenHands(dict.fromkeys(ALL, (release, press)))
    prompt = LatencyEqualiser(own, latency, give=lambda ago: moments.append(frame - ago))
    prompt.time(ALL)
    prompt.rest()
    prompt.seen_late = seen_late
    moments.clear()
    for frame in range(latency + 28):
        prompt.command(Keys.UP if 3 <= frame < 11 else Keys.DOWN if 11 <= frame < 19 else Keys.NONE)
        prompt.step_frame()
    assert moments == [3, *turns, 19]  # UP and, in the end, neither


@pytest.mark.parametrize(("release", "turns"), [(0, [43, 43]), (3, [43, 43]), (5, [43])])
def test_a_key_that_a_hand_leaves_and_presses_again_is_timed_from_the_later_command(
    release: int, turns: list[int]
) -> None:
    """From DOWN and LEFT to LEFT alone, which the hand of equal latency leaves in between."""
    moments: list[int] = []
    own = UnevenHands(dict.fromkeys(ALL, (release, release + (release > 3))))
    prompt = LatencyEqualiser(own, EQUAL, give=lambda ago: moments.append(frame - ago))
    frame = 0
    prompt.time(ALL)
    prompt.rest()
    moments.clear()
    for frame in range(EQUAL + 60):
        prompt.command(
            Keys.NONE if frame < 3 else Keys.LEFT if frame >= 43 else Keys.DOWN | Keys.LEFT
        )
        prompt.step_frame()
    assert moments == [3, *turns]


@pytest.mark.parametrize("release", [4, 9])
def test_a_hand_at_rest_sets_out_no_sooner_because_it_is_slow_in_play(release: int) -> None:
    """A key that is commanded again before it is released counts as two frames later than that."""
    waiting = LatencyEqualiser(UnevenHands({Keys.UP: (release, 1)}), EQUAL)
    waiting.time(Keys.UP)
    waiting.rest()
    assert waiting._keys_by_latency == {HandLatency(release, 1, release + 2): int(Keys.UP)}
    assert play(waiting, [2] * 8) == schedule([2] * 8, EQUAL)


UNEVEN = {
    Keys.LEFT: (5, 6), Keys.RIGHT: (0, 0), Keys.UP: (3, 1), Keys.DOWN: (0, 2), Keys.FIRE: (2, 2),
}  # fmt: skip


@given(ACTIONS)
@example([3, 4, 3])
def test_a_slow_key_takes_no_time_of_a_quick_one(actions: list[int]) -> None:
    waiting = LatencyEqualiser(UnevenHands(UNEVEN), EQUAL)
    waiting.time(ALL)
    waiting.rest()
    felt, due = play(waiting, actions, 5), schedule(actions, EQUAL, 5)
    for key in (Keys.RIGHT, Keys.FIRE):
        assert [keys & key for keys in felt] == [keys & key for keys in due]


class Recorded(UnevenHands):
    """Hands that keep the last command they got."""

    got = Keys.NONE

    def command(self, keys: Keys) -> None:
        self.got = keys
        super().command(keys)


def due(told: list[int], lead: int, got: int, latencies: dict[HandLatency, int]) -> int:
    """What hands that ``got`` a command have to set out for after the commands ``told``, one for
    each frame, if each is to be obeyed ``lead`` frames later: the whole schedule, made anew.

    Keys are whole numbers, because sets of `Keys` take ten times as long.
    """

    def seen_in(frames: int) -> int:
        frame = len(told) - 1 + min(frames - lead, 0)
        return told[frame] if frame >= 0 else 0

    def held_in(frames: int) -> int:
        held = 0
        for hand in (0b01111, 0b10000):
            goal, *before = (seen_in(frames - ago) & hand for ago in range(8))
            if all(keys == goal for keys in before[: 2 if any(before[1:]) else 1]):
                held |= goal
        return held

    set_out = 0
    for (release, press, in_play), keys in latencies.items():
        either, both = 0, ~0
        for frames in range(min(release, press), max(release, press) + 1):
            either, both = either | held_in(frames), both & held_in(frames)
        wanted = either if press > release else both
        for frames in range(press + 1, in_play + 1):
            wanted |= held_in(frames) & ~held_in(frames - 1) & seen_in(frames - 2)
        wanted &= keys
        for pair in (0b0011, 0b1100):
            if set_out & pair:
                wanted &= ~pair
            elif wanted & pair == pair:
                wanted &= ~pair | got
        set_out |= wanted
    return set_out


UNEVEN_KEYS = st.fixed_dictionaries(
    {key: st.tuples(st.integers(0, 20), st.integers(0, 20)) for key in ALL}
)
SPELLS = st.lists(
    st.tuples(st.integers(0, 17), st.integers(1, 9), st.integers(0, 16)), min_size=1, max_size=12
)
"""Commands, the frames that each lasts, and how late it is seen."""


@settings(max_examples=50)
@given(UNEVEN_KEYS, SPELLS)
@example(UNEVEN, [(3, 4, 0), (4, 4, 0), (3, 1, 4), (0, 9, 14)])
@example(UNEVEN | dict.fromkeys(Keys.UP | Keys.DOWN, (4, 0)), [(2, 4, 0), (5, 20, 0)])
def test_each_frame_sets_out_for_what_the_whole_schedule_says(
    uneven: dict[Keys, tuple[int, int]], spells: list[tuple[int, int, int]]
) -> None:
    recorded = Recorded(uneven)
    waiting = LatencyEqualiser(recorded, EQUAL)
    waiting.time(ALL)
    waiting.rest()
    recorded.got, told = Keys.NONE, list[int]()
    for action, frames, waiting.seen_late in spells:
        waiting.command(KEYS_OF_ACTION[action])
        for _ in range(frames):
            told.append(int(KEYS_OF_ACTION[action]))
            lead = EQUAL - waiting.seen_late
            expected = due(told, lead, int(recorded.got), waiting._keys_by_latency)
            waiting.step_frame()
            assert recorded.got == expected


def test_what_is_seen_late_leaves_the_hands_less_time() -> None:
    late = equal(3)
    late.seen_late = 4
    assert play(late, [1, 0, 2, 5]) == schedule([1, 0, 2, 5], EQUAL - 4)


def test_hands_that_no_one_has_timed_count_as_without_latency() -> None:
    new = LatencyEqualiser(hands(latency=3), EQUAL)
    actions = [2, 0, 1, 3, *[0] * 5]  # nothing is held before the 16th frame
    assert play(new, actions) == schedule(actions, EQUAL + 3)


def test_the_game_knows_nothing_of_the_timing_before_it() -> None:
    env = RobotEnv(play=PlayConfig(equal_latency=EQUAL, random_starts=0, eye="emulator"))
    env.reset(seed=1)
    info = env.step(0)[4]
    assert info["keys_match"]
    assert info["key_times"] == ()
    env.close()


def test_what_waits_is_forgotten_with_the_game() -> None:
    waiting = equal()
    play(waiting, [1, 3])
    waiting.rest()
    assert not any(waiting.step_frame() for _ in range(30))


def keys_felt(play: PlayConfig) -> list[np.ndarray]:
    """The keys of each frame of random play of Pong by a robot's own hands."""
    play = replace(play, minimal_actions=True, vector=True, random_starts=0, eye="emulator")
    env = RobotEnv(play=play)
    env.reset(seed=1)
    rng, keys = np.random.default_rng(2), []
    for step in range(150):
        if step % 3 == 0:
            action = rng.integers(6)
        observation, *_ = env.step(action)
        assert isinstance(observation, dict)
        keys += list(observation["vector"][108:128].reshape(4, 5))
    env.close()
    return keys


def agreement(one: list[np.ndarray], other: list[np.ndarray]) -> float:
    """The share of frames in which both hold the same keys."""
    return float(np.mean([(a == b).all() for a, b in zip(one, other, strict=True)]))


def test_the_hands_of_a_robot_become_those_of_the_model_however_late_they_are() -> None:
    exact = keys_felt(PlayConfig(hand="model", equal_latency=EQUAL))
    for latency in (0, 7):
        nao = PlayConfig(actuation_latency=latency, equal_latency=EQUAL)
        assert agreement(keys_felt(nao), exact) == 1
    roller = PlayConfig(robot="robotroller", equal_latency=EQUAL)
    # Its stick swings back from the middle, and is a frame late from right to left.
    assert agreement(keys_felt(roller), exact) > 0.98
    assert agreement(keys_felt(replace(roller, actuation_latency=7)), keys_felt(roller)) == 1
    own = keys_felt(PlayConfig(robot="robotroller", actuation_latency=EQUAL))
    assert agreement(own, exact) < 0.96


@pytest.mark.parametrize("gap", [4, 8])
@pytest.mark.parametrize("robot", ["nao", "robotroller"])
def test_with_a_longer_gap_the_hands_of_both_robots_are_exact(robot: str, gap: int) -> None:
    """A hand that presses 4 frames after a release still moves, and after 8 frames it rests."""
    exact = PlayConfig(hand="model", equal_latency=EQUAL, equal_gap=gap)
    play = PlayConfig(robot=robot, equal_latency=EQUAL, equal_gap=gap)
    assert agreement(keys_felt(play), keys_felt(exact)) == 1
