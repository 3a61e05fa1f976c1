"""The robot's four modes: waiting or not, in lockstep or in real time."""

import math
import multiprocessing
import os
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.envs.clock import MAX_MISSED, Lockstep, RealTime
from actors.envs.robot import RobotEnv
from actors.envs.world import AgentStep
from common.actions import KEYS_OF_ACTION, Keys
from common.settings.clock import ClockConfig
from common.settings.conditions import CameraConfig, PlayConfig
from tests.actors.envs.narrowed import nao_of
from tests.patience import PATIENCE, wait_until

WAITING = ClockConfig(wait_action=True)
PLAY = PlayConfig(random_starts=0)
GAMMA = 0.9


class ScriptedClock(Lockstep):
    """Agent steps as they come, some of them before the command."""

    def __init__(self, missed: list[AgentStep], passing: list[list[AgentStep]]) -> None:
        self.late_frames = 0
        self._missed = missed
        self._passing = iter(passing)

    def command(self, action: int) -> list[AgentStep]:
        return list(self._missed)

    def pass_agent_step(self) -> list[AgentStep]:
        self.late_frames += 1
        return next(self._passing)


def agent_step(
    points: float, pressed: Keys = Keys.NONE, end: str = "", *, late: bool = False
) -> AgentStep:
    return AgentStep(points, pressed, end == "terminated", end == "truncated", late)


@pytest.fixture(scope="module")
def patient() -> Iterator[RobotEnv]:
    """An environment that waits, and clips rewards."""
    env = RobotEnv(play=PLAY, discount=GAMMA, clock=WAITING, clip_rewards=True)
    env.reset(seed=0)
    yield env
    env.close()


@pytest.fixture(scope="module")
def hasty() -> Iterator[RobotEnv]:
    """One that does neither."""
    env = RobotEnv(play=PLAY, discount=GAMMA)
    env.reset(seed=0)
    yield env
    env.close()


def step(
    env: RobotEnv, missed: list[AgentStep], *passing: list[AgentStep]
) -> tuple[float, bool, bool, dict[str, Any]]:
    """What a step tells in which these agent steps pass, with fire commanded."""
    env._clock, env._late_frames = ScriptedClock(missed, list(passing)), 0
    env._world.wanted = Keys.FIRE
    _, reward, terminated, truncated, info = env.step(1)
    return reward, terminated, truncated, info


def test_a_wait_is_paid_for_with_its_true_time(patient: RobotEnv) -> None:
    """Three agent steps until the keys are right: points clipped, then discounted one by one."""
    passing = [agent_step(5.0)], [agent_step(-0.5, Keys.UP)], [agent_step(1.0, Keys.FIRE)]
    reward, terminated, truncated, info = step(patient, [], *passing)
    assert reward == pytest.approx(1.0 - 0.5 * GAMMA + 1.0 * GAMMA**2)
    assert (info["elapsed"], info["keys_match"], info["gave_up"]) == (3, True, False)
    assert (info["missed_deadlines"], info["late_frames"]) == (0, 3)
    assert not terminated
    assert not truncated


def test_a_wait_is_bounded_and_says_so(patient: RobotEnv) -> None:
    reward, _, _, info = step(patient, [], *[[agent_step(1.0)]] * 20)
    assert info["elapsed"] == PLAY.wait_bound
    assert (info["keys_match"], info["gave_up"]) == (False, True)
    assert reward == pytest.approx((1 - GAMMA**PLAY.wait_bound) / (1 - GAMMA))


@pytest.mark.parametrize("end", ["terminated", "truncated"])
def test_an_episodes_end_ends_the_wait(patient: RobotEnv, end: str) -> None:
    passing = [agent_step(0.0)], [agent_step(2.0, end=end)]
    reward, terminated, truncated, info = step(patient, [], *passing)
    assert (terminated, truncated) == (end == "terminated", end == "truncated")
    assert (info["elapsed"], info["gave_up"]) == (2, False)
    assert reward == pytest.approx(1.0 * GAMMA)


def test_each_picture_of_a_wait_is_told_the_agent_steps_since_the_one_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """If told more, a late camera would show what it saw less long ago."""
    env = RobotEnv(play=PLAY, clock=WAITING, camera=CameraConfig(latency=1))
    env.reset(seed=0)
    told: list[int] = []
    picture = env.robot.camera_picture

    def recorded(screen: NDArray[np.uint8], agent_steps: int) -> NDArray[np.uint8]:
        told.append(agent_steps)
        return picture(screen, agent_steps)

    monkeypatch.setattr(env.robot, "camera_picture", recorded)
    passing = [[agent_step(0.0)]] * 3 + [[agent_step(0.0, Keys.FIRE)]]
    step(env, [agent_step(0.0)], *passing)
    assert told == [2, 1, 1, 1]
    env.close()


def test_without_waiting_one_agent_step_is_enough_whatever_is_pressed(hasty: RobotEnv) -> None:
    reward, _, _, info = step(hasty, [], [agent_step(3.0, Keys.UP)])
    assert (reward, info["elapsed"]) == (3.0, 1)
    assert (info["keys_match"], info["gave_up"]) == (False, False)


def test_what_was_missed_counts_for_the_step_that_missed_it(hasty: RobotEnv) -> None:
    missed = [agent_step(1.0), agent_step(2.0)]
    passing = [agent_step(4.0, Keys.FIRE), agent_step(8.0, Keys.FIRE)]
    reward, _, _, info = step(hasty, missed, passing)
    assert reward == pytest.approx(1 + 2 * GAMMA + 4 * GAMMA**2 + 8 * GAMMA**3)
    assert (info["elapsed"], info["missed_deadlines"]) == (4, 3)  # the command was for one of them


def test_what_passes_while_an_agent_waits_for_its_keys_is_not_missed(patient: RobotEnv) -> None:
    passing = [agent_step(4.0), agent_step(8.0)], [agent_step(1.0, Keys.FIRE)]
    *_, info = step(patient, [agent_step(2.0)], *passing)
    assert (info["elapsed"], info["missed_deadlines"]) == (4, 1)


@pytest.mark.parametrize(
    ("late", "missed"),
    [
        ([False, False, False], 2),  # the command was for the second
        ([True, False, True], 2),  # each of those that were missed anyway counts once
        ([False, True, False], 3),
    ],
)
def test_an_agent_step_that_is_late_itself_is_missed(
    hasty: RobotEnv, late: list[bool], missed: int
) -> None:
    before, now, after = (agent_step(1.0, Keys.FIRE, late=each) for each in late)
    *_, info = step(hasty, [before], [now, after])
    assert (info["elapsed"], info["missed_deadlines"]) == (3, missed)


def test_late_agent_steps_of_a_wait_are_missed(patient: RobotEnv) -> None:
    passing = [agent_step(4.0), agent_step(8.0, late=True)], [agent_step(1.0, Keys.FIRE)]
    *_, info = step(patient, [agent_step(2.0)], *passing)
    assert (info["elapsed"], info["missed_deadlines"]) == (4, 2)


def test_an_end_that_was_missed_ends_the_step_at_once(hasty: RobotEnv) -> None:
    reward, terminated, _, info = step(hasty, [agent_step(1.0), agent_step(2.0, end="terminated")])
    assert terminated
    assert reward == pytest.approx(1 + 2 * GAMMA)
    assert (info["elapsed"], info["missed_deadlines"]) == (2, 2)


def test_waiting_in_lockstep_ends_with_the_keys_that_were_commanded() -> None:
    env = RobotEnv(play=PLAY, clock=WAITING)
    env.reset(seed=1)
    rng = np.random.default_rng(0)
    agent_steps = 0
    for action in rng.integers(18, size=40):
        *_, info = env.step(int(action))
        agent_steps += info["elapsed"]
        assert info["keys_match"]
        assert env.pressed == KEYS_OF_ACTION[action]
        assert info["game_steps"] == agent_steps
        assert env.emulator.frames == 4 * agent_steps
    env.close()


@pytest.mark.parametrize("waits", ["paused", "alone"])
def test_a_paused_robot_misses_nothing(waits: str) -> None:
    env = RobotEnv(play=PLAY, clock=ClockConfig(sync=False, speed=20.0))
    with closing(env):
        env.reset(seed=0)
        clock = env._clock
        assert isinstance(clock, RealTime)
        if waits == "paused":
            with env.paused():
                time.sleep(0.5)  # 150 agent steps
            assert clock._deadlines.delay() > -0.4  # none to be made up for
        else:
            wait_until(lambda: len(clock._passed) >= MAX_MISSED, "agent steps pass")
        *_, info = env.step(0)
    if waits == "paused":
        assert info["elapsed"] < MAX_MISSED
    else:
        assert info["elapsed"] >= MAX_MISSED


def test_a_hand_that_does_not_move_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    env = RobotEnv(play=PlayConfig(random_starts=0, wait_bound=3), clock=WAITING)
    env.reset(seed=1)
    monkeypatch.setattr(nao_of(env).arms.right, "advance", lambda: None)
    *_, info = env.step(1)
    assert (info["elapsed"], info["gave_up"], info["keys_match"]) == (3, True, False)
    env.close()


def test_the_papers_order_is_an_agent_step_later() -> None:
    pressed: dict[str, list[Keys]] = {}
    for order in ("frame", "decision"):
        env = RobotEnv(play=PlayConfig(random_starts=0, read_keys=order))
        env.reset(seed=1)
        pressed[order] = []
        for action in (1, 1, 1, 0, 0, 0):
            env.step(action)
            pressed[order].append(env.pressed)
        env.close()
    none, fire = Keys.NONE, Keys.FIRE
    assert pressed["frame"] == [fire, fire, fire, none, none, none]
    assert pressed["decision"] == [none, fire, fire, fire, none, none]


def frames_and_seconds(env: RobotEnv, seconds: float) -> tuple[int, float, int, int]:
    """Play at random for so long; emulator frames, monotonic seconds in which a game ran, missed
    agent steps, late frames."""
    rng = np.random.default_rng(0)
    began: list[float] = []  # of each game
    start = env._clock.start

    def start_now() -> None:
        began.append(time.monotonic())
        start()

    env._clock.start = start_now  # type: ignore[method-assign]
    env.reset(seed=1)
    frames = missed = late = 0
    running = 0.0
    while running + time.monotonic() - began[-1] < seconds:
        _, _, terminated, truncated, info = env.step(int(rng.integers(18)))
        missed += info["missed_deadlines"]
        late += info["late_frames"]
        if terminated or truncated:  # no game time passes between two episodes
            frames += env.emulator.frames
            running += time.monotonic() - began[-1]
            env.reset(options={"new_game": True})
    with env._clock.still():
        frames += env.emulator.frames
        running += time.monotonic() - began[-1]
    # A frame that is overdue by now is told of by this step only.
    *_, info = env.step(0)
    return frames, running, missed, late + info["late_frames"]


@pytest.mark.parametrize("wait_action", [False, True])
def test_seconds_of_real_time_are_seconds_of_the_game(wait_action: bool) -> None:
    env = RobotEnv(play=PLAY, clock=ClockConfig(sync=False, wait_action=wait_action))
    frames, seconds, _, late = frames_and_seconds(env, 1.0)
    env.close()
    assert frames / 60 <= seconds
    # Each picture is taken while the world stands still, which then makes up for it. A machine
    # that is too slow for that is told of.
    assert frames / 60 > seconds - 0.5 or late


def test_an_agent_that_thinks_too_long_misses_agent_steps_and_is_told() -> None:
    env = RobotEnv(play=PLAY, clock=ClockConfig(sync=False), discount=GAMMA)
    env.reset(seed=1)
    *_, info = env.step(0)
    steps = info["game_steps"]
    began = time.monotonic()
    while env._world._game.steps < steps + 4:  # the world goes on without it
        assert time.monotonic() - began < 60
        time.sleep(0.01)
    *_, info = env.step(1)
    assert info["missed_deadlines"] >= 4
    # The agent step that obeys counts too where the machine began one of its frames too late.
    assert info["elapsed"] >= info["missed_deadlines"] + (info["late_frames"] == 0)
    assert info["game_steps"] >= steps + 5
    env.close()


class Outrun(RealTime):
    """The agent loses the processor, until the game is over, as soon as the world need not wait."""

    def pass_agent_step(self) -> list[AgentStep]:
        passed = super().pass_agent_step()
        overtaking = threading.Thread(target=self._overtake)
        overtaking.start()
        overtaking.join()
        return passed

    def _overtake(self) -> None:
        if self._changed.acquire(blocking=False):
            while self._running and self._failure is None:
                self._changed.wait(PATIENCE)
            self._changed.release()


def test_a_world_that_overtakes_the_agent_ends_no_game_twice(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("actors.envs.robot.RealTime", Outrun)
    play = replace(PLAY, eye="emulator", max_game_frames=24)
    env = RobotEnv(play=play, clock=ClockConfig(sync=False))
    env.reset(seed=1)
    elapsed, truncated = 0, False
    while not truncated:
        *_, truncated, info = env.step(0)
        elapsed += info["elapsed"]
        assert (info["game_over"], info["game_steps"]) == (truncated, elapsed)
    assert elapsed == 6
    env.close()


def burn(parent: int) -> None:
    """Keep a core busy for as long as the test lives."""
    number = 1.0
    while os.getppid() == parent:
        for _ in range(100_000):
            number = math.sqrt(number + 1.0)


@pytest.mark.slow
def test_a_minute_of_real_time_on_a_loaded_machine_is_right_to_one_percent() -> None:
    """Twice as many busy processes as cores beside the robot."""
    context = multiprocessing.get_context("spawn")
    burners = [
        context.Process(target=burn, args=(os.getpid(),), daemon=True)
        for _ in range(2 * len(os.sched_getaffinity(0)))
    ]
    for burner in burners:
        burner.start()
    try:
        env = RobotEnv(play=PLAY, clock=ClockConfig(sync=False))
        frames, seconds, missed, late = frames_and_seconds(env, 60.0)
        env.close()
    finally:
        for burner in burners:
            burner.terminate()
            burner.join()
    print(f"{frames} frames in {seconds:.2f} s; {missed} agent steps missed, {late} frames late")
    assert seconds >= 60
    assert frames / 60 == pytest.approx(seconds, rel=0.01)
