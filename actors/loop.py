"""The acting loop: agent and environments take turns. All else happens around it.

It is a generator, so streaming, statistics and stopping stay with whoever iterates.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from actors.policy import Policy


class Step(NamedTuple):
    """One decision of one environment."""

    stream: int
    """Index of the environment."""
    begins: bool
    """It is the first of its episode."""
    s_tm1: NDArray[np.uint8]
    """State acted on, ``[history, 84, 84]``, newest frame last."""
    valid: bool
    """The newest frame of ``s_tm1`` showed the screen."""
    a_tm1: int
    r_t: float
    terminated: bool
    truncated: bool
    s_t: NDArray[np.uint8]
    info: dict[str, Any]
    """What the environment said after the step."""


def play(
    envs: Sequence[gymnasium.Env[Any, Any]], policy: Policy, seeds: Sequence[int]
) -> Iterator[Step]:
    """Endless steps, environment by environment; an ended episode is followed by a reset."""
    first = [env.reset(seed=seed) for env, seed in zip(envs, seeds, strict=True)]
    states = np.stack([state for state, _ in first])
    valid = [bool(info["valid_frame"]) for _, info in first]
    begins = [True] * len(envs)
    no_vectors = np.zeros((len(envs), 0), np.float32)
    while True:
        actions = policy.act(states, no_vectors)
        for i, env in enumerate(envs):
            s_t, r_t, terminated, truncated, info = env.step(actions[i])
            yield Step(
                stream=i,
                begins=begins[i],
                s_tm1=states[i],
                valid=valid[i],
                a_tm1=int(actions[i]),
                r_t=float(r_t),
                terminated=terminated,
                truncated=truncated,
                s_t=s_t,
                info=info,
            )
            begins[i] = terminated or truncated
            if begins[i]:
                s_t, info = env.reset()
            states[i] = s_t
            valid[i] = bool(info["valid_frame"])
