"""Where a network on disk comes from: the settings under which it was trained."""

import json
from pathlib import Path

from common.errors import InputError
from common.run.config import RunConfig, from_mapping
from common.run.folder import RunFolder


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


def run_of(weights: Path) -> RunFolder | None:
    """The run in whose folder, or in whose snapshots, ``weights`` lies; None if it is no run's."""
    for folder in weights.resolve().parents[:2]:
        if (folder / "config.json").is_file():
            return RunFolder(folder.parent, folder.name)
    return None
