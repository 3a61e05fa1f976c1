"""Finds networks on disk, and the settings of their training."""

import hashlib
import json
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open

from common.errors import InputError, cannot_read, choice
from common.pinned_file import with_hash
from common.run.folder import RunFolder
from common.settings.conditions import PlayConfig
from common.settings.config import RunConfig
from common.settings.stored_config import from_mapping, to_json

SHIPPED = Path(__file__).resolve().parents[2] / "ale_robot" / "policies"
"""Folder of the published policies and their cards."""
SHOWN = {"robot_pong": "robot_pong_sticky", "ale_pong": "ale_pong_sticky"}
"""By environment and game, the published policy that plays if none is named, where there are
several: the best under sticky actions."""
_BY_OTHER_HANDS = {"robot_pong": "robot_pong_robust"}
"""The same for a robot whose hands it need not have learned with."""


def find_weights(name: str | Path) -> Path:
    """Returns the file that ``name`` stands for: the first that there is of

    1. this file;
    2. the newest network of the run whose folder it is;
    3. the published policy of that name, as robot_pong or policies/robot_pong.safetensors;
    4. this file with ``.safetensors``, which `learner.publish` adds;
    5. the newest network of the run in ``runs/`` whose name it is.

    Raises InputError if there is none.
    """
    path = Path(name)
    if (run := run_meant_by(path)) is not None:
        lost = not run.checkpoint.exists() and run.previous.is_file()
        path = run.previous if lost else run.checkpoint
    elif (file := _in_full(path)) is not None:
        path = file
    if not path.is_file():
        wrong = "is not a file" if os.path.lexists(path) else "does not exist"
        raise InputError(f"{path} {wrong}: {_what_there_is(path)}")
    return path


def run_meant_by(path: Path) -> RunFolder | None:
    """Returns the run whose newest network `find_weights` takes for ``path``, or None."""
    return None if path.is_file() or _in_full(path) is not None else RunFolder.named(path)


def _in_full(path: Path) -> Path | None:
    """Returns the published policy, or else the file, that is meant by ``path`` without its suffix;
    None if there is neither, or something has just that name."""
    if path.exists():
        return None
    shipped, file = SHIPPED / f"{path.stem}.safetensors", Path(f"{path}.safetensors")
    if path.parent in (Path(), Path("policies")) and shipped.is_file():
        return shipped
    return file if file.is_file() else None


def _what_there_is(missing: Path) -> str:
    """Returns the end of a sentence that refuses ``missing``, with the networks that exist."""
    run = run_of(missing)
    if run is not None and missing.parent.is_dir():
        there = [file.name for file in missing.parent.glob("*.safetensors")]
        if meant := choice(missing.name, there, ""):
            return meant
    if run is not None and run.checkpoint.is_file():
        return f"name {run.path} for its newest network; the best is there once a test has ended."
    published = sorted(file.stem for file in SHIPPED.glob("*.safetensors"))
    known = ", ".join(published)
    all_kinds = f"name a network's file, a run, or a published policy: {known}."
    return choice(missing.stem, published, all_kinds) if missing.parent == Path() else all_kinds


def name_of(weights: Path) -> str:
    """Returns the name that people use for a file of `find_weights`: the path, or the name of a
    published policy."""
    return weights.stem if weights.parent == SHIPPED else str(weights)


def shown_weights(env: str, game: str, robot: str = PlayConfig.robot) -> Path | None:
    """Returns the network that plays the ``game`` in the environment ``env`` by the ``robot`` if no
    network is named; None if none is published."""
    name, shown = f"{env}_{game}", SHOWN
    if env == "robot" and robot != PlayConfig.robot:
        shown = _BY_OTHER_HANDS
    file = SHIPPED / f"{shown.get(name, name)}.safetensors"
    return file if file.is_file() else None


def identity_of(weights: Path) -> str:
    """Returns how records name the network in a file: ``NAME#sha256=HASH``, where the name is a
    published policy's, or the file's with that of its folder. Raises InputError if the file cannot
    be read."""
    real = weights.resolve()
    named = real.stem if real.parent == SHIPPED.resolve() else "/".join(real.parts[-2:])
    try:
        with weights.open("rb") as file:
            return with_hash(named, hashlib.file_digest(file, "sha256").hexdigest())
    except OSError as error:
        raise cannot_read(weights, error) from None


_CONFIG = "config"
"""Key of the training's settings in a network's file and in a policy's card."""
_IDENTITY = "identity"
"""Key, in a run's copy of the network that it began with, of that network's identity."""


def origin_metadata(trained: RunConfig, identity: str | None = None) -> dict[str, str]:
    """Returns the settings of a network's training, as metadata of safetensors.

    Args:
        identity: of the file of which the network is a copy, see `identity_of`.
    """
    return {_CONFIG: to_json(trained)} | ({} if identity is None else {_IDENTITY: identity})


def copied_from(weights: Path) -> str | None:
    """Returns the identity of the file of which ``weights`` is a copy; None if the file does not
    tell, as those of former versions, or is damaged."""
    with suppress(InputError):
        return _metadata(weights).get(_IDENTITY)
    return None


def origin_of(weights: Path) -> RunConfig | None:
    """Returns the settings of a network's training, or None if they are not found.

    They are in the file ``weights`` itself. For files of former versions, they are in the card of a
    published policy, or in the run whose folder or snapshots hold the file. Raises InputError if
    they exist and cannot be read, or if the file is not a network's.
    """
    card, config, where = weights.with_suffix(".json"), None, weights
    if (told := _metadata(weights).get(_CONFIG)) is not None:
        config = _json(told, weights)
    elif card.is_file() and isinstance(told := _json(card.read_bytes(), card), dict):
        config, where = told.get(_CONFIG), card
    if config is not None:
        return from_mapping(RunConfig, config, f"{where}: config", fill=True)
    run = run_of(weights)
    return run.stored_config() if run else None


def trained_settings(weights: Path) -> RunConfig:
    """Returns the settings of a network's training. Raises InputError as `origin_of` does, and if
    they are not found."""
    if (found := origin_of(weights)) is None:
        raise InputError(
            f"the settings of the training of {weights} are unknown: keep it in its run's folder, "
            f"or beside its card, {weights.with_suffix('.json').name}."
        )
    return found


def _metadata(weights: Path) -> dict[str, str]:
    """Returns the metadata of the file ``weights``; empty if it cannot be read, which loading it
    will show."""
    try:
        with safe_open(weights, "np") as file:
            return file.metadata() or {}
    except SafetensorError as error:
        raise not_a_network(weights, error) from None
    except OSError:
        return {}


def not_a_network(file: Path, error: Exception) -> InputError:
    """Returns the error that says that ``file`` is not a network's."""
    run = run_of(file)
    if run is not None and file.name == run.checkpoint.name and run.previous.is_file():
        return InputError(f"{file} is damaged ({error}): name {run.previous}, the one before.")
    return InputError(f"{file} holds no network ({error}): name a .safetensors file.")


def _json(text: str | bytes, file: Path) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{file} is not JSON ({error}): get it again.") from None


def run_of(weights: Path) -> RunFolder | None:
    """Returns the run whose folder or snapshots hold ``weights``; None if there is none."""
    # `Path.resolve` raises RuntimeError for a link to itself.
    for folder in Path(os.path.realpath(weights)).parents[:2]:
        if (run := RunFolder.at(folder)) is not None:
            return run
    return None
