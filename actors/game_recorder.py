"""Records the game being played: hashes that tell it from other games, and how long it took."""

import hashlib
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import gymnasium

from actors.envs.observation import frames_and_vector
from actors.envs.step_info import StepInfo

_BYTES = 8
"""Size of a hash. The chance that any two of 30 different games share one is 2e-17."""


class GameRecorder(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment that hashes its console's memory after each step.

    Two games with equal hashes are the same game, played twice. Without a console, the newest frame
    is hashed instead. A game may have several episodes.

    Args:
        ending: number of last steps of a game that are also hashed by themselves.
        now: returns monotonic seconds.
    """

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        ending: int,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(env)
        self.seconds = 0.0
        """Seconds of the present game from its reset to its last step."""
        self._now = now
        self._steps: deque[bytes] = deque(maxlen=ending)
        self._over = True

    def reset(self, **how: Any) -> tuple[Any, dict[str, Any]]:
        found = self.env.reset(**how)
        if self._over:
            self._whole = hashlib.blake2b(digest_size=_BYTES)
            self._steps.clear()
            self._began = self._now()
            self._over = False
        return found

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self.env.step(action)
        self.seconds = self._now() - self._began
        inner = self.env.unwrapped
        memory = inner.ram() if hasattr(inner, "ram") else frames_and_vector(observation)[0][-1]
        self._whole.update(memory.tobytes())
        self._steps.append(hashlib.blake2b(memory.tobytes(), digest_size=_BYTES).digest())
        self._over = StepInfo.of(info).game_over
        return observation, reward, terminated, truncated, info

    @property
    def game_hash(self) -> str:
        """Hash of the present game's memory over all its steps."""
        return self._whole.hexdigest()

    @property
    def ending_hash(self) -> str:
        """Hash of its memory over the last ``ending`` agent steps, or over all if it is shorter."""
        return hashlib.blake2b(b"".join(self._steps), digest_size=_BYTES).hexdigest()
