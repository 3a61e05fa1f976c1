"""The acting loop: agent and environments take turns.

It is a generator, so streaming, statistics and stopping are left to the code that iterates.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, Protocol

import gymnasium
import numpy as np
from numpy.typing import NDArray

from actors.envs.observation import NO_VECTOR, frames_and_vector
from actors.envs.step_info import StepInfo


class Step(NamedTuple):
    """One step of one environment: one agent step, or several (``info.elapsed``)."""

    stream: int
    """Index of the environment."""
    begins: bool
    """Whether it is the first of its episode."""
    s_tm1: NDArray[np.uint8]
    """State acted on, ``[frame_stack, 84, 84]``, newest frame last."""
    valid: bool
    """Whether the newest frame of ``s_tm1`` showed the screen."""
    a_tm1: int
    explored: bool
    """Whether ``a_tm1`` was random."""
    r_t: float
    terminated: bool
    truncated: bool
    s_t: NDArray[np.uint8]
    info: StepInfo
    """What the environment said after the step."""
    x_tm1: NDArray[np.float32] = NO_VECTOR
    """Vector observation beside ``s_tm1``, ``[P]``."""
    x_t: NDArray[np.float32] = NO_VECTOR
    weights_version: int = 0
    """Version of the weights that chose ``a_tm1``."""
    epsilon: float = 1.0
    """The policy's ε when it chose ``a_tm1``."""


class Player(Protocol):
    """Chooses the actions: an `actors.policy.Policy`, or a person."""

    weights_version: int
    epsilon: float
    explored: NDArray[np.bool_]
    """Which of the last actions were random, ``[E]``."""

    def act(self, frames: NDArray[np.uint8], vectors: NDArray[np.float32]) -> NDArray[np.int64]:
        """Returns one action for each environment, ``[E]``.

        Args:
            frames: states ``[E, frame_stack, 84, 84]``.
            vectors: vector observations ``[E, P]``.
        """


def seeds_of(seed: int) -> tuple[int, int]:
    """Returns the seeds of a player and of its environment, whose random numbers must differ."""
    player, env = map(int, np.random.SeedSequence(seed).generate_state(2))
    return player, env


def play(
    envs: Sequence[gymnasium.Env[Any, Any]],
    policy: Player,
    seeds: Sequence[int],
    options: Callable[[], dict[str, Any]] = dict,
) -> Iterator[Step]:
    """Yields endless steps, environment by environment; after an episode it resets.

    Args:
        options: returns the options of the next reset.
    """
    first = [env.reset(seed=seed, options=options()) for env, seed in zip(envs, seeds, strict=True)]
    observed = [frames_and_vector(observation) for observation, _ in first]
    states = np.stack([frames for frames, _ in observed])
    vectors = np.stack([vector for _, vector in observed])
    valid = [StepInfo.of(info).valid_frame for _, info in first]
    begins = [True] * len(envs)
    while True:
        actions = policy.act(states, vectors)
        # While it takes these steps, the consumer may give the policy other weights.
        weights_version, epsilon = policy.weights_version, float(policy.epsilon)
        for i, env in enumerate(envs):
            observation, r_t, terminated, truncated, told = env.step(actions[i])
            info = StepInfo.of(told)
            s_t, x_t = frames_and_vector(observation)
            yield Step(
                stream=i,
                begins=begins[i],
                s_tm1=states[i],
                valid=valid[i],
                a_tm1=int(actions[i]),
                explored=bool(policy.explored[i]),
                r_t=float(r_t),
                terminated=terminated,
                truncated=truncated,
                s_t=s_t,
                info=info,
                x_tm1=vectors[i],
                x_t=x_t,
                weights_version=weights_version,
                epsilon=epsilon,
            )
            begins[i] = terminated or truncated
            if begins[i]:
                observation, told = env.reset(options=options())
                info = StepInfo.of(told)
                s_t, x_t = frames_and_vector(observation)
            states[i], vectors[i] = s_t, x_t
            valid[i] = info.valid_frame
