"""Any game that ale-py bundles starts, resets and plays on the robot, and the robot sees it."""

from contextlib import closing

import numpy as np
import pytest

from actors.envs.robot import RobotEnv
from common.games import GAMES
from common.settings.conditions import PlayConfig

# A picture of 250 rows; black to its very edge; one that flashes all over; one that starts black.
UNUSUAL = ("carnival", "asteroids", "yars_revenge", "video_cube")


@pytest.mark.parametrize(
    ("game", "agent_steps"),
    [
        *((game, 80) for game in UNUSUAL),
        *(pytest.param(game, 500, marks=pytest.mark.slow) for game in GAMES),
    ],
)
def test_the_game_is_seen_and_goes_on_at_random_play(game: str, agent_steps: int) -> None:
    with closing(RobotEnv(game, play=PlayConfig(random_starts=5))) as env:
        env.reset(seed=1)
        rng = np.random.default_rng(1)
        valid = 0
        frames = set()
        for action in rng.integers(18, size=agent_steps):
            state, reward, terminated, truncated, info = env.step(int(action))
            assert isinstance(state, np.ndarray)
            assert env.observation_space.contains(state)
            assert np.isfinite(reward)
            frames.add(state[-1].tobytes())
            valid += info["valid_frame"]
            if terminated or truncated:
                _, info = env.reset()
                assert not info["game_over"]
        _, info = env.reset(options={"new_game": True})
    assert info["valid_frame"]
    assert valid / agent_steps >= 0.99
    assert len(frames) > 5
