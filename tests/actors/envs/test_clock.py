"""Lockstep and real time, the latter mostly under a time that the test itself passes."""

import threading
import time
from collections.abc import Callable, Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.envs.clock import BREATH, FRAME, MAX_MISSED, Deadlines, Lockstep, RealTime
from actors.envs.world import AgentStep, World
from common.actions import Keys

SKIP = 4
AGENT_STEP = SKIP * FRAME
A_WHILE = 20.0


class CountingWorld(World):
    """Agent steps whose points are their number; it notes the command of each frame."""

    def __init__(self, ends: int | None = None) -> None:
        self.frames = 0
        self.under: list[int] = []
        self._action = 0
        self._ends = ends

    def command(self, action: int) -> None:
        self._action = action

    def frame(self) -> AgentStep | None:
        self.frames += 1
        self.under.append(self._action)
        number, left = divmod(self.frames, SKIP)
        return None if left else AgentStep(float(number), Keys.NONE, number == self._ends, False)

    def finish_agent_step(self) -> AgentStep:
        while (agent_step := self.frame()) is None:
            pass
        return agent_step


class HandTime:
    """Time that passes when the test says so, and not by itself."""

    def __init__(self) -> None:
        self._seconds = 1_000.0
        self._idle = threading.Event()
        self.changed: threading.Condition

    def now(self) -> float:
        return self._seconds

    def wait(self, changed: threading.Condition, seconds: float | None) -> None:
        if seconds == BREATH:
            return  # a late world goes on at once
        self.changed = changed
        self._idle.set()
        changed.wait(A_WHILE)

    def settle(self) -> None:
        """Until the world waits for its next frame, or for someone."""
        assert self._idle.wait(A_WHILE)

    def go_on(self, seconds: float) -> None:
        self.settle()
        with self.changed:
            self._idle.clear()
            # Just beyond, so that rounding does not decide which frames are due.
            self._seconds += seconds + 1e-9
            self.changed.notify_all()
        self.settle()


@pytest.fixture
def hand() -> HandTime:
    return HandTime()


@pytest.fixture
def run(hand: HandTime) -> Iterator[Callable[..., RealTime]]:
    clocks: list[RealTime] = []

    def start(world: CountingWorld, speed: float = 1.0) -> RealTime:
        clocks.append(RealTime(world, speed, now=hand.now, wait=hand.wait))
        clocks[-1].start()
        return clocks[-1]

    yield start
    for clock in clocks:
        clock.close()


def numbers(agent_steps: list[AgentStep]) -> list[float]:
    return [agent_step.points for agent_step in agent_steps]


def test_in_lockstep_nothing_passes_by_itself() -> None:
    world = CountingWorld()
    clock = Lockstep(world)
    clock.start()
    assert clock.command(3) == []
    assert numbers(clock.pass_agent_step()) == [1]
    assert world.under == [3] * SKIP
    clock.close()


@given(st.lists(st.floats(0.0, 0.2), max_size=60))
def test_deadlines_never_drift(delays: list[float]) -> None:
    """However late frames begin, the n-th is due n periods after the start."""
    now = 5.0
    deadlines = Deadlines(FRAME, lambda: now)
    deadlines.restart()
    for number, delay in enumerate(delays, start=1):
        due = 5.0 + number * FRAME
        assert deadlines.delay() == pytest.approx(due - now, abs=1e-9)
        now = max(now, due) + delay
        lateness = now - due
        if abs(lateness - FRAME) > 1e-9:
            assert deadlines.meet() == (lateness > FRAME)
        else:
            deadlines.meet()


def test_the_world_goes_on_by_itself_in_time(hand: HandTime, run: Callable[..., RealTime]) -> None:
    world = CountingWorld()
    clock = run(world)
    for frames in (1, 1, 2, 5, 30):
        before = world.frames
        hand.go_on(frames * FRAME)
        assert world.frames == before + frames
    # All but the last of a burst were due (a hair more than) one frame before it.
    assert clock.late_frames == 0 + 0 + 1 + 4 + 29
    assert numbers(clock.command(0)) == [1, 2, 3, 4, 5, 6, 7, 8, 9]


def test_an_agent_step_is_late_if_a_frame_of_it_is(
    hand: HandTime, run: Callable[..., RealTime]
) -> None:
    clock = run(CountingWorld())
    # Of two frames at once the first was due (a hair more than) a frame ago.
    for frames in (
        *(1, 1, 1, 1),
        *(1, 2, 1),
        *(1, 1, 1, 2),  # and the first frame of the next one, in time
        *(1, 1, 1),
        *(1, 2),
    ):
        hand.go_on(frames * FRAME)
    assert [each.late for each in clock.command(0)] == [False, True, True, False]
    clock.stop()
    clock.start()  # another episode
    hand.go_on(FRAME)
    assert [each.late for each in clock.pass_agent_step()] == [False]


def test_a_world_that_cannot_go_as_fast_as_its_clock_is_late_all_the_time(
    hand: HandTime, run: Callable[..., RealTime]
) -> None:
    """At 200 times the speed a frame has 83 µs; these take 525 µs, 31.8 times real time."""

    class SlowWorld(CountingWorld):
        def frame(self) -> AgentStep | None:
            hand._seconds += FRAME / 31.8
            return super().frame()

    clock = run(SlowWorld(ends=10), speed=200.0)
    hand.go_on(AGENT_STEP / 31.8)
    assert [each.late for each in clock.pass_agent_step()] == [True] * 10


def test_speed_scales_time(hand: HandTime, run: Callable[..., RealTime]) -> None:
    world = CountingWorld()
    run(world, speed=3.0)
    hand.go_on(1.0)
    assert world.frames == 180


def test_a_prompt_agent_misses_nothing(hand: HandTime, run: Callable[..., RealTime]) -> None:
    world = CountingWorld()
    clock = run(world)
    for number in range(1, 6):
        assert clock.command(number) == []
        hand.go_on(AGENT_STEP)
        assert numbers(clock.pass_agent_step()) == [number]
    assert world.under == [action for action in range(1, 6) for _ in range(SKIP)]


def test_a_late_agent_gets_what_it_missed(hand: HandTime, run: Callable[..., RealTime]) -> None:
    world = CountingWorld()
    clock = run(world)
    clock.command(1)
    hand.go_on(3 * AGENT_STEP + 2 * FRAME)
    assert numbers(clock.command(2)) == [1, 2, 3]
    hand.go_on(2 * FRAME)
    assert numbers(clock.pass_agent_step()) == [4]
    assert world.under == [1] * 14 + [2] * 2


def test_nothing_passes_while_the_agent_waits_for_something_else(
    hand: HandTime, run: Callable[..., RealTime]
) -> None:
    world = CountingWorld()
    clock = run(world)
    hand.go_on(2 * FRAME)
    late = clock.late_frames
    with clock.paused():
        hand._seconds += 100 * AGENT_STEP
        with clock.still():  # somebody looks at it meanwhile
            assert world.frames == 2
    hand.go_on(2 * FRAME)  # in time, from there
    assert world.frames == SKIP
    assert clock.late_frames == late + 1  # the first of the two that were due at once
    assert numbers(clock.command(0)) == [1]


def test_a_pause_keeps_the_worlds_thread_waiting() -> None:
    world = CountingWorld()
    clock = RealTime(world, 50.0)
    clock.start()
    with clock.paused():
        before = world.frames
        time.sleep(0.2)
        assert world.frames == before
    clock.close()


def test_a_command_after_the_end_is_for_nobody(
    hand: HandTime, run: Callable[..., RealTime]
) -> None:
    world = CountingWorld(ends=2)
    clock = run(world)
    clock.command(1)
    hand.go_on(3 * AGENT_STEP)
    assert [each.ended for each in clock.command(2)] == [False, True]
    clock.start()
    hand.go_on(AGENT_STEP)
    assert set(world.under) == {1}


def test_nothing_passes_after_an_end_until_the_next_start(
    hand: HandTime, run: Callable[..., RealTime]
) -> None:
    world = CountingWorld(ends=2)
    clock = run(world)
    hand.go_on(10 * AGENT_STEP)
    assert world.frames == 2 * SKIP
    assert [agent_step.ended for agent_step in clock.pass_agent_step()] == [False, True]
    clock.start()
    hand.go_on(AGENT_STEP)
    assert world.frames == 3 * SKIP
    assert numbers(clock.pass_agent_step()) == [3]


def test_stopped_means_stopped(hand: HandTime, run: Callable[..., RealTime]) -> None:
    world = CountingWorld()
    clock = run(world)
    hand.go_on(FRAME)
    clock.stop()
    hand.go_on(10 * FRAME)
    assert world.frames == 1


def test_an_episode_begins_without_what_was_missed_of_the_one_before(
    hand: HandTime, run: Callable[..., RealTime]
) -> None:
    clock = run(CountingWorld())
    hand.go_on(2 * AGENT_STEP)
    clock.stop()
    clock.start()
    assert clock.command(0) == []
    hand.go_on(AGENT_STEP)
    assert numbers(clock.pass_agent_step()) == [3]


def test_a_world_that_nobody_attends_to_stops(hand: HandTime, run: Callable[..., RealTime]) -> None:
    world = CountingWorld()
    clock = run(world)
    hand.go_on(10 * MAX_MISSED * AGENT_STEP)
    assert world.frames == MAX_MISSED * SKIP
    hand.settle()
    assert len(clock.command(0)) == MAX_MISSED
    # And goes on from there in time, without making up for the pause.
    hand.go_on(AGENT_STEP)
    assert numbers(clock.pass_agent_step()) == [MAX_MISSED + 1]


def test_a_world_that_breaks_is_not_waited_for() -> None:
    class Broken(CountingWorld):
        def frame(self) -> AgentStep | None:
            raise ZeroDivisionError

    clock = RealTime(Broken())
    clock.start()
    with pytest.raises(ZeroDivisionError):
        clock.pass_agent_step()
    with pytest.raises(ZeroDivisionError):
        clock.start()
    clock.close()


@pytest.mark.parametrize("how", ["ended", "stopped", "closed"])
def test_nobody_waits_for_a_time_that_does_not_pass(
    hand: HandTime, run: Callable[..., RealTime], how: str
) -> None:
    clock = run(CountingWorld(ends=1))
    if how == "ended":
        hand.go_on(AGENT_STEP)
        assert numbers(clock.pass_agent_step()) == [1]
    elif how == "stopped":
        clock.stop()
    else:
        clock.close()
    assert clock.command(3) == []
    with pytest.raises(RuntimeError, match="reset"):
        clock.pass_agent_step()


def test_closing_ends_the_thread_and_twice_does_no_harm(run: Callable[..., RealTime]) -> None:
    before = threading.active_count()
    clock = run(CountingWorld())
    assert threading.active_count() == before + 1
    clock.close()
    clock.close()
    assert threading.active_count() == before


def test_two_seconds_of_real_time() -> None:
    """At three times the speed: 6 s of game time; a loaded machine may be late, which is told,
    but no frame is early."""
    looks: list[float] = []
    begun: list[float] = []

    def now() -> float:
        looks.append(time.monotonic())
        return looks[-1]

    class TimedWorld(CountingWorld):
        def frame(self) -> AgentStep | None:
            begun.append(looks[-1])  # by which the clock judged that the frame is due
            return super().frame()

    period, agent_steps = FRAME / 3.0, 90  # fewer than those after which it stops for nobody
    clock = RealTime(TimedWorld(ends=agent_steps), speed=3.0, now=now)
    looks.clear()
    clock.start()
    passed: list[AgentStep] = []
    while len(passed) < agent_steps:
        passed += clock.pass_agent_step()
    clock.close()
    assert numbers(passed) == [float(number) for number in range(1, agent_steps + 1)]
    assert len(begun) == agent_steps * SKIP
    late = [at - looks[0] - number * period for number, at in enumerate(begun, start=1)]
    assert min(late) > -1e-9
    assert clock.late_frames == sum(seconds > period for seconds in late)
