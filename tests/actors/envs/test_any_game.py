"""Any game that ale-py bundles starts, resets and plays on the robot, and the robot sees it."""

import numpy as np
import pytest

from actors.envs.robot import RobotEnv
from common.games import GAMES
from common.run.conditions import PlayConfig

# A picture of 250 rows; black to its very edge; one that flashes all over; one that starts black.
UNUSUAL = ("carnival", "asteroids", "yars_revenge", "video_cube")


def play(game: str, agent_steps: int) -> tuple[float, int]:
    """Share of valid frames, and how many different frames there were, at random play."""
    env = RobotEnv(game, play=PlayConfig(random_starts=5))
    try:
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
        return valid / agent_steps, len(frames)
    finally:
        env.close()


@pytest.mark.parametrize("game", UNUSUAL)
def test_unusual_games(game: str) -> None:
    valid, frames = play(game, 80)
    assert valid >= 0.99
    assert frames > 5


@pytest.mark.slow
@pytest.mark.parametrize("game", GAMES)
def test_every_game(game: str) -> None:
    valid, frames = play(game, 500)
    assert valid >= 0.99
    assert frames > 5
