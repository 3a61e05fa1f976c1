"""What hands did in recorded games, from which a latency model learns too.

Random commands show hands as nobody plays by them. Games of a network that learned by a first model
show the sequences of commands on which its play depends (Ross et al. 2011, "A reduction of
imitation learning and structured prediction to no-regret online learning").
"""

from pathlib import Path

import numpy as np

from actors.robots.latency import AGENT_STEP
from actors.robots.latency_model.recording import Recording
from actors.robots.latency_model.weights import COMMANDS
from common.actions import KEYS_OF_ACTION, action_of_keys
from common.dataset.reader import Dataset, Rows
from common.errors import InputError
from common.games import MINIMAL_ACTIONS
from common.proprioception import KEYS, vector_widths
from common.registry import ENVIRONMENTS
from common.settings.config import RunConfig


def played(folder: Path, robot: str, robot_settings: str) -> list[Recording]:
    """Returns what the hands of ``robot`` did in each game of the recording in ``folder``.

    Args:
        robot: as ``play.robot`` of a run, with the hash of a file.

    Raises:
        InputError: the folder holds no recording, its games were played by other hands, or it does
            not show all commands and keys.
    """
    dataset = Dataset(folder)
    _check(folder, dataset.config, robot, robot_settings)
    try:
        # The keys of a single step are not known.
        return [_game(each, dataset.config) for each in dataset.read() if len(each["actions"]) > 1]
    except ValueError as error:
        raise InputError(f"{folder} {error}.") from None


def _check(folder: Path, config: RunConfig, robot: str, robot_settings: str) -> None:
    play = config.play
    own = play.latency_model or (ENVIRONMENTS.find(config.env).robot and play.hand == "arm")
    if not own or (play.robot, play.robot_settings) != (robot, robot_settings):
        raise InputError(
            f"{folder} was not played by the hands of {robot}: record games with the same --robot "
            "and --play.robot-settings."
        )
    if not (play.vector and play.vector_key_frames >= AGENT_STEP == play.frame_skip):
        raise InputError(
            f"{folder} does not show the keys of every frame: record games with --play.vector and "
            f"--play.vector-key-frames {AGENT_STEP} or more."
        )
    for name in ("actuation_latency", "actuation_jitter", "equal_latency"):
        if getattr(play, name) or getattr(config.randomise, name, 0):
            raise InputError(
                f"{folder} was played with late commands: record games without "
                f"--play.{name.replace('_', '-')} and its range."
            )


def _game(rows: Rows, config: RunConfig) -> Recording:
    """Raises ValueError with what is wrong of the rows."""
    if (rows["elapsed"] != 1).any():
        raise ValueError("has a game that waited for its keys: record without --wait-action")
    play = config.play
    actions = MINIMAL_ACTIONS[config.game] if play.minimal_actions else range(len(KEYS_OF_ACTION))
    # What a step's hands held is in the vector of the next state, so the last step's is unknown.
    widths = vector_widths(play, 0)
    end = widths.commands + widths.keys
    newest = rows["vectors"][1:, end - AGENT_STEP * len(KEYS) : end]
    if rows["actions"].max() >= len(actions) or not np.isin(newest, (0, 1)).all():
        raise ValueError("is damaged: an action or a key is none of the game's; record again")
    pressed = newest.reshape(-1, len(KEYS)).astype(np.int64) @ np.array(KEYS)
    wanted = np.array(actions)[rows["actions"][:-1]].repeat(AGENT_STEP)
    held = np.array([action_of_keys(keys) for keys in pressed.tolist()], np.int64)
    # A game's random start is not recorded.
    return Recording(wanted, held, known_from=min(COMMANDS, len(wanted)))
