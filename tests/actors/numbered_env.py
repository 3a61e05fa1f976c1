"""An environment whose frames are numbered and whose endings are scripted; it remembers all."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from actors.envs.step_info import StepInfo

GOES_ON, LOSES_A_LIFE, GAME_OVER, CUT = "-", "l", "x", "t"


def numbered_frame(number: int) -> NDArray[np.uint8]:
    """A frame like no other of the first 2³²."""
    frame = np.full((84, 84), number % 256, np.uint8)
    frame[0, :4] = np.frombuffer(np.uint32(number).tobytes(), np.uint8)
    return frame


class Moment(NamedTuple):
    """One agent step as the environment lived it."""

    state: NDArray[np.uint8]
    valid: bool
    begins: bool
    action: int
    reward: float
    ending: str
    next_state: NDArray[np.uint8]
    info: dict[str, Any]
    vector: NDArray[np.float32]
    next_vector: NDArray[np.float32]


class NumberedEnv(gymnasium.Env[Any, np.int64]):
    """Steps end as ``endings`` says, over and over; frames count up from ``first``.

    With a ``width`` there is a vector beside the frames, filled with the newest one's number. Every
    observation is in the same arrays, as an environment from elsewhere may do.
    """

    def __init__(
        self, endings: Sequence[str], frame_stack: int = 4, first: int = 0, width: int = 0
    ) -> None:
        self.observation_space = gymnasium.spaces.Box(0, 255, (frame_stack, 84, 84), np.uint8)
        self.action_space = gymnasium.spaces.Discrete(6)
        self.moments: list[Moment] = []
        self.seeds: list[int | None] = []
        self.options: list[dict[str, Any] | None] = []
        """Seed and options of each reset."""
        self._endings = endings
        self._frame_stack = frame_stack
        self._number = first
        self._width = width
        self._shown = np.zeros((frame_stack, 84, 84), np.uint8)
        self._shown_vector = np.zeros(width, np.float32)
        self._score = 0.0
        self._steps = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        self.seeds.append(seed)
        self.options.append(options)
        self._begins = True
        self._state = np.stack([self._next_frame()] * self._frame_stack)
        self._valid = self._number % 5 != 0
        return self._observation(), self._info(over=False, elapsed=0)

    def step(self, action: np.int64 | int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        ending = self._endings[len(self.moments) % len(self._endings)]
        reward = float(self._number % 7 - 3)
        self._score += reward
        self._steps += 1
        state, valid, vector = self._state, self._valid, self._vector()
        self._state = np.concatenate((state[1:], self._next_frame()[None]))
        self._valid = self._number % 5 != 0
        info = self._info(over=ending in (GAME_OVER, CUT), elapsed=self._number % 3 + 1)
        self.moments.append(
            Moment(
                state,
                valid,
                self._begins,
                int(action),
                reward,
                ending,
                self._state,
                dict(info),
                vector,
                self._vector(),
            )
        )
        self._begins = False
        if info["game_over"]:
            self._score, self._steps = 0.0, 0
        terminated = ending in (LOSES_A_LIFE, GAME_OVER)
        return self._observation(), reward, terminated, ending == CUT, info

    def _vector(self) -> NDArray[np.float32]:
        return np.full(self._width, self._number, np.float32)

    def _observation(self) -> Any:
        self._shown[:], self._shown_vector[:] = self._state, self._vector()
        if not self._width:
            return self._shown
        return {"frames": self._shown, "vector": self._shown_vector}

    def _next_frame(self) -> NDArray[np.uint8]:
        self._number += 1
        return numbered_frame(self._number)

    def _info(self, *, over: bool, elapsed: int) -> dict[str, Any]:
        return StepInfo(
            over,
            self._score,
            self._steps,
            valid_frame=self._number % 5 != 0,
            frame_follows=self._number % 3 == 0,
            keys_match=self._number % 2 == 0,
            elapsed=elapsed,
        )._asdict()
