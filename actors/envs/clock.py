"""Two clocks: in lockstep the world waits for the agent, in real time it goes on without it.

An environment asks its clock to pass agent steps and never moves the world itself. Everything else
is therefore the same under both.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from typing import Protocol

from actors.envs.world import AgentStep, World
from common.settings.conditions import FRAMES_PER_SECOND

FRAME = 1 / FRAMES_PER_SECOND
"""Seconds of game time per emulator frame."""
MAX_MISSED = 100
"""Agent steps that nobody has collected, after which the world pauses: a chunk counts the agent
steps of a step in one byte."""
BREATH = 5e-5
"""Seconds that a late world waits between two frames; otherwise the agent's thread starves."""


class Clock(Protocol):
    """Passes the agent steps of a world."""

    late_frames: int
    """Number of frames so far that began more than a frame too late."""

    def start(self) -> None:
        """Lets time pass, because an episode begins."""

    def stop(self) -> None:
        """Lets no time pass until the next `start`."""

    def still(self) -> AbstractContextManager[object]:
        """Returns a context in which the world stands still, so that it can be looked at; what is
        late then is made up for."""

    def paused(self) -> AbstractContextManager[object]:
        """Returns a context in which no time passes."""

    def command(self, action: int) -> list[AgentStep]:
        """Gives a command; returns the agent steps that passed before it because it came late."""

    def pass_agent_step(self) -> list[AgentStep]:
        """Returns the next agent step, or all of them up to now if several have passed.

        Do not call it after an episode's end.
        """

    def close(self) -> None:
        """Stops for good; closing twice does no harm."""


class Lockstep:
    """A clock that passes the world's agent steps while the agent waits for each of them."""

    def __init__(self, world: World) -> None:
        self.late_frames = 0
        self._world = world

    def start(self) -> None: ...

    def stop(self) -> None: ...

    def still(self) -> AbstractContextManager[object]:
        return nullcontext()

    def paused(self) -> AbstractContextManager[object]:
        return nullcontext()

    def command(self, action: int) -> list[AgentStep]:
        self._world.command(action)
        return []

    def pass_agent_step(self) -> list[AgentStep]:
        return [self._world.finish_agent_step()]

    def close(self) -> None: ...


class Deadlines:
    """The times at which frames are due, at a fixed rate, so that delays never add up."""

    def __init__(self, period: float, now: Callable[[], float]) -> None:
        self._period = period
        self._now = now
        self._due = now()

    def restart(self) -> None:
        """Lets the next frame be due one period from now."""
        self._due = self._now() + self._period

    def delay(self) -> float:
        """Returns the seconds until the next frame is due; zero or less if it is due."""
        return self._due - self._now()

    def meet(self) -> bool:
        """Begins the frame that is due; returns whether it is more than a whole frame late."""
        late = self._now() - self._due > self._period
        self._due += self._period
        return late


class RealTime:
    """A clock that passes time by itself, frame by frame, in a thread of its own.

    A command takes effect when it comes, and is answered at the end of the agent step that is then
    running. An agent step for which no command came in time passes under the old command. Late
    frames are made up for at once, as fast as the machine goes. Time stands still outside episodes,
    and after `MAX_MISSED` agent steps that the agent did not collect.

    Args:
        speed: game seconds per second.
        now: returns monotonic seconds.
        wait: waits on a condition for at most the given seconds, for ever if None.
    """

    def __init__(
        self,
        world: World,
        speed: float = 1.0,
        *,
        now: Callable[[], float] = time.monotonic,
        wait: Callable[[threading.Condition, float | None], object] = threading.Condition.wait,
    ) -> None:
        self.late_frames = 0
        self._world = world
        self._wait = wait
        self._deadlines = Deadlines(FRAME / speed, now)
        self._changed = threading.Condition()
        self._passed: list[AgentStep] = []
        self._late = False  # whether a frame of the present agent step was late
        self._running = False
        self._closing = False
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._keep_time, name="real-time", daemon=True)

    def start(self) -> None:
        with self._changed:
            if self._failure is not None:  # a thread that has ended cannot be started again
                raise self._failure
            self._passed.clear()
            self._late = False
            self._running = True
            self._deadlines.restart()
            self._changed.notify_all()
        if not self._thread.is_alive():
            self._thread.start()

    def stop(self) -> None:
        with self._changed:
            self._running = False

    def still(self) -> AbstractContextManager[object]:
        return self._changed

    @contextmanager
    def paused(self) -> Iterator[None]:
        with self._changed:
            yield
            self._deadlines.restart()

    def command(self, action: int) -> list[AgentStep]:
        with self._changed:
            passed = self._take()
            if not (passed and passed[-1].ended):  # else it would be of the next episode
                self._world.command(action)
            return passed

    def pass_agent_step(self) -> list[AgentStep]:
        """Returns the next agent steps, as `Clock.pass_agent_step`.

        Raises:
            RuntimeError: the clock is stopped, so no agent step would ever come.
        """
        with self._changed:
            while not self._passed:
                if self._failure is not None:
                    raise self._failure
                if self._closing or not self._running:
                    raise RuntimeError("the episode is over: reset the environment first")
                self._changed.wait()
            return self._take()

    def close(self) -> None:
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join()

    def _take(self) -> list[AgentStep]:
        passed, self._passed = self._passed, []
        if len(passed) >= MAX_MISSED:
            self._deadlines.restart()
            self._changed.notify_all()
        return passed

    def _keep_time(self) -> None:
        try:
            with self._changed:
                while not self._closing:
                    self._turn()
        except BaseException as failure:
            with self._changed:
                self._failure = failure
                self._changed.notify_all()

    def _turn(self) -> None:
        """Waits for the next frame, or passes it if it is due."""
        if not self._running or len(self._passed) >= MAX_MISSED:
            self._wait(self._changed, None)
            return
        delay = self._deadlines.delay()
        if delay > 0:
            self._wait(self._changed, delay)
            return
        late = self._deadlines.meet()
        self.late_frames += late
        self._late = self._late or late
        agent_step = self._world.frame()
        if agent_step is not None:
            self._passed.append(replace(agent_step, late=self._late))
            self._late = False
            self._running = not agent_step.ended
            self._changed.notify_all()
        # Waiting releases the lock; beside a world that is always late the agent would starve.
        self._wait(self._changed, BREATH)
