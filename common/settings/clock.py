"""`ClockConfig`: the settings of time, declared and checked for actors, learner and viewer."""

from dataclasses import dataclass

from common.errors import InputError
from common.registry import ENVIRONMENTS


@dataclass(frozen=True)
class ClockConfig:
    """Whether a robot's world waits for its agent, and how long a step lasts."""

    sync: bool = True
    """Lockstep of physics, emulator and agent, as fast as the machine allows. With --no-sync,
    physics and game run in real time and do not wait for the agent."""
    wait_action: bool = False
    """Waiting for the keys: a robot's step lasts until the commanded keys are pressed, at most
    --play.wait-bound agent steps."""
    speed: float = 1.0
    """Speed of game and physics with --no-sync, game seconds per second."""

    def check(self, env: str | None = None, envs: int = 1) -> None:
        """Checks that the settings can work, in the environment called ``env`` if it is known, with
        so many ``envs`` in a process. Raises InputError with the flag at fault and what to do."""
        if not 0 < self.speed < float("inf"):
            raise InputError(f"--speed is {self.speed}: choose a finite number above 0.")
        if self.sync and self.speed != 1.0:
            raise InputError("--speed is for --no-sync: with --sync time goes as fast as it can.")
        if envs > 1 and not self.sync:  # while one waits for its agent step, others miss theirs
            raise InputError("--no-sync needs an actor for each environment: omit --envs.")
        if env and (flag := self.robot_flag) and not ENVIRONMENTS.find(env).robot:
            raise InputError(f"{flag} is for a robot, and --env {env} has none: omit it.")

    @property
    def robot_flag(self) -> str:
        """The first flag in use that only a robot's world supports; empty if there is none."""
        return "--no-sync" if not self.sync else "--wait-action" if self.wait_action else ""

    def flags(self) -> list[str]:
        """Returns the flags that give a child process the same clock."""
        flags = ["--sync"] if self.sync else ["--no-sync", "--speed", f"{self.speed:g}"]
        return [*flags, "--wait-action"] if self.wait_action else flags

    def __str__(self) -> str:
        real_time = "" if self.sync else f", in real time × {self.speed:g}"
        return real_time + (", waiting for its keys" if self.wait_action else "")
