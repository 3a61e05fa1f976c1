"""Where a network on disk comes from: the settings under which it was trained."""

import json
from pathlib import Path

from common.errors import InputError
from common.pinned_file import path_of
from common.registry import ENVIRONMENTS
from common.run.config import RunConfig
from common.run.folder import RunFolder
from common.run.stored_config import from_mapping


def origin_of(weights: Path) -> RunConfig | None:
    """The settings in the card of a published policy; or those of the run whose folder ``weights``
    lies in, or in whose snapshots; None where neither is found.

    Raises:
        InputError: they are there and cannot be read.
    """
    card = weights.with_suffix(".json")
    if card.is_file():
        try:
            told = json.loads(card.read_bytes())
        except ValueError as error:
            raise InputError(f"{card} is not JSON ({error}): get it anew.") from None
        if isinstance(told, dict) and "config" in told:
            return from_mapping(RunConfig, told["config"], f"{card}: config", fill=True)
    run = run_of(weights)
    return run.stored_config() if run else None


def check_vector(weights: Path, trained: RunConfig | None, config: RunConfig) -> None:
    """Refuses to play under ``config`` with a network whose vector observation was another one.

    Args:
        trained: settings under which ``weights`` were trained; None if nobody knows.

    Raises:
        InputError: with what the network needs and what there is.
    """
    if trained is None or trained.vector_width == config.vector_width:
        return
    needed, given = (_vector_of(each) for each in (trained, config))
    raise InputError(
        f"{weights} was trained with {needed} beside the frames, and here there is {given}: choose "
        "what it was trained with by --env, --robot and --play.vector, or a network that was "
        "trained without --play.vector."
    )


def _vector_of(config: RunConfig) -> str:
    """Returns in words what vector observation there is."""
    if not config.vector_width:
        return "no vector"
    robot = ENVIRONMENTS.find(config.env).robot
    body = f"the robot {path_of(config.play.robot)}" if robot else f"--env {config.env}"
    return f"the vector of {body} ({config.vector_width} numbers)"


def run_of(weights: Path) -> RunFolder | None:
    """The run in whose folder, or in whose snapshots, ``weights`` lies; None if it is no run's."""
    for folder in weights.resolve().parents[:2]:
        if (folder / "config.json").is_file():
            return RunFolder(folder.parent, folder.name)
    return None
