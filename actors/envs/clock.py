"""Whose time it is: the world waits for the agent (lockstep), or goes on without it (real time).

An environment asks its clock to pass agent steps and never moves the world itself, so that all else
is the same in both.
"""

import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace

from actors.envs.world import AgentStep, World
from common.run.conditions import FRAMES_PER_SECOND

FRAME = 1 / FRAMES_PER_SECOND
"""Seconds of game time per emulator frame."""
MOST_MISSED = 100
"""Agent steps after which a world that nobody attends to stops, as on a console put on pause. A
chunk counts the agent steps of a step in one byte, and a held actor should not lose its games."""
BREATH = 5e-5
"""Seconds that a late world waits between two frames; otherwise the agent thread starves."""


class Lockstep:
    """Passes the world's agent steps, each while the agent waits for it."""

    def __init__(self, world: World) -> None:
        self.late_frames = 0
        """Frames so far that began more than a frame too late."""
        self._world = world

    def start(self) -> None:
        """Let time pass: an episode begins."""

    def stop(self) -> None:
        """Let no time pass until the next `start`."""

    def still(self) -> AbstractContextManager[object]:
        """While it is entered the world stands still, to be looked at."""
        return nullcontext()

    def command(self, action: int) -> list[AgentStep]:
        """Give a command; the agent steps that passed before it, for want of one."""
        self._world.command(action)
        return []

    def pass_agent_step(self) -> list[AgentStep]:
        """The next agent step, or all up to now if there were several; never after an episode's
        end."""
        return [self._world.finish_agent_step()]

    def close(self) -> None:
        """Stop for good; closing twice does no harm."""


class Deadlines:
    """When frames are due: at a fixed rate from the start on, so that lateness never adds up."""

    def __init__(self, period: float, now: Callable[[], float]) -> None:
        self._period = period
        self._now = now
        self._due = now()

    def restart(self) -> None:
        """The next frame is due one period from now."""
        self._due = self._now() + self._period

    def delay(self) -> float:
        """Seconds until the next frame is due; not positive if it is."""
        return self._due - self._now()

    def meet(self) -> bool:
        """Begin the frame that is due; whether it is late by more than a whole frame."""
        late = self._now() - self._due > self._period
        self._due += self._period
        return late


class RealTime(Lockstep):
    """Time passes by itself, frame by frame, in a thread of its own.

    The agent's command takes effect when it comes, and it is answered at the end of the agent step
    that runs by then. If it was not ready in time for the agent step before, that one has passed
    under the old command. What is late is made up for at once, as fast as the machine goes. Time
    stands still outside episodes, and when nobody comes for `MOST_MISSED` agent steps.

    Args:
        speed: game seconds per second.
        now: monotonic seconds.
        wait: waits on a condition for at most so many seconds, for ever if None.
    """

    def __init__(
        self,
        world: World,
        speed: float = 1.0,
        *,
        now: Callable[[], float] = time.monotonic,
        wait: Callable[[threading.Condition, float | None], object] = threading.Condition.wait,
    ) -> None:
        super().__init__(world)
        self._wait = wait
        self._deadlines = Deadlines(FRAME / speed, now)
        self._changed = threading.Condition()
        self._passed: list[AgentStep] = []
        self._late = False  # a frame of the present agent step was
        self._running = False
        self._closing = False
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._keep_time, name="real-time", daemon=True)

    def start(self) -> None:
        with self._changed:
            if self._failure is not None:  # its thread has ended, and cannot be started again
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

    def command(self, action: int) -> list[AgentStep]:
        with self._changed:
            self._world.command(action)
            return self._take()

    def pass_agent_step(self) -> list[AgentStep]:
        """As `Lockstep.pass_agent_step`.

        Raises:
            RuntimeError: no time passes, so that none would ever come.
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
        if len(passed) >= MOST_MISSED:
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
        """Wait for the next frame, or pass it if it is due."""
        if not self._running or len(self._passed) >= MOST_MISSED:
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
        # Waiting gives the lock away; the agent would starve beside a world that is always late.
        self._wait(self._changed, BREATH)
