"""`python -m learner.publish runs/NAME -o policies/NAME`: publishes a run's network as a policy.

It writes two files: NAME.safetensors, the weights in float16, and NAME.json, the card. The card
has the SHA-256 of the weights, the run's configuration, how long it was trained, and the score of
each game of an evaluation of exactly these weights.

`ale-robot play policies/NAME.safetensors` plays the policy.
"""

import hashlib
import json
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import torch
import tyro

from common.atomic_file import check_new_file, write_atomically, write_json
from common.checked import FromOne
from common.command_line.parser import parse
from common.crc32 import crc32
from common.errors import InputError, writing
from common.exit_codes import INTERRUPTED
from common.network import QNetwork, build_network, count_actions_of
from common.process.lifeline import on_signals
from common.process.program_end import exit_on_input_error
from common.protocol.weights import set_weights
from common.run.epochs import EpochTable
from common.run.folder import RunFolder
from common.run.network_file import decode_network_file, encode_network_file
from common.settings.clock import ClockConfig
from common.settings.config import RunConfig
from learner.checkpoint import counters_of
from learner.evaluation.offline import evaluate
from learner.evaluation.options import GAMES, EvaluationOptions
from learner.evaluation.snapshots import Snapshots

_FROM_SUMMARY = (
    "run",
    "agent_steps",
    "updates",
    "wall_seconds",
    "random_reward",
    "machine",
    "git_commit",
    "config",
)
_WRITTEN_ANEW = "continue the run with --resume until it is written again"


@dataclass(frozen=True)
class Options:
    """Publish a run's last weights, with a card of their scores."""

    run: tyro.conf.Positional[Path]
    """Run, or its folder."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Path of both files, without suffix."""
    best: bool = False
    """Publish the weights of the best test instead. They are chosen by their luck, too, so the
    card's games, which are others, score less than that test."""
    replace: bool = False
    """Replace the policy that is there."""
    games: FromOne = GAMES
    """Number of games in each of the card's evaluations."""


def publish(options: Options, stop: threading.Event) -> dict[str, Any]:
    """Writes both files, once the evaluation is over; returns the card.

    Args:
        stop: ends the evaluation early once it is set.

    Raises:
        InputError: the run lacks the weights or what the card needs, the output has no name or is
            there already, or the evaluation was stopped.
    """
    if options.output.name in ("", ".."):
        raise InputError(f"{options.output} names no file: give -o a name, such as policies/NAME.")
    if options.output.suffix in (".safetensors", ".json"):
        raise InputError(f"{options.output} has a suffix: give -o the name without it.")
    folder = RunFolder.existing(options.run)
    if options.output.resolve().is_relative_to(folder.path.resolve()):
        raise InputError(f"{options.output} is inside of the run: name a file outside.")
    weights, told = (
        options.output.with_name(f"{options.output.name}.{suffix}")
        for suffix in ("safetensors", "json")
    )
    for file in (weights, told):
        if file.exists() and not options.replace:
            raise InputError(f"{file} is there already: add --replace, or name another.")
        check_new_file(file)  # before the games, not after them
    config, network, card = _trained(options, folder)
    published = encode_network_file(network, config, torch.float16)
    card["sha256"] = hashlib.sha256(published).hexdigest()
    asked = EvaluationOptions(headline=True, games=options.games)
    with tempfile.TemporaryDirectory() as place:
        evaluated = Path(place, weights.name)
        evaluated.write_bytes(published)
        scores = evaluate(evaluated, asked, config.for_play, ClockConfig(), stop, name=weights.stem)
    if scores is None:
        raise InputError(
            "the evaluation was stopped, so nothing is published: publish again.", INTERRUPTED
        )
    card["evaluation"] = scores
    with writing(options.output):
        write_atomically(weights, published)
        write_json(told, card)
    return card


def _trained(options: Options, folder: RunFolder) -> tuple[RunConfig, QNetwork, dict[str, Any]]:
    """Returns the run's settings, the network to publish, and what the card says of its
    training."""
    config = folder.stored_config()
    assert config is not None  # or it would not be a run
    network, own = (_best if options.best else _last)(folder, config)
    summary = _read(folder.summary)
    if missing := [name for name in _FROM_SUMMARY if name not in summary]:
        raise InputError(
            f"{folder.summary} is from an earlier version, without {', '.join(missing)}: "
            f"{_WRITTEN_ANEW}."
        )
    card = {name: summary[name] for name in _FROM_SUMMARY}
    card["initial"] = summary.get("initial")
    card["demonstrations"] = summary.get("demonstrations", 0)
    # The summary may be of later steps than the weights, or of fewer.
    return config, network, card | own


def _last(folder: RunFolder, config: RunConfig) -> tuple[QNetwork, dict[str, Any]]:
    """Returns the last network, and what the card says of it alone."""
    weights = _content(folder.checkpoint)
    with _decoding(folder.checkpoint):
        return _network(weights, config), counters_of(weights)


def _best(folder: RunFolder, config: RunConfig) -> tuple[QNetwork, dict[str, Any]]:
    """Returns the network of the best test, and what the card says of it alone."""
    snapshots = Snapshots(folder.snapshots)
    if not snapshots.best.exists() and folder.checkpoint.exists():
        raise InputError(
            f"no test of {folder.path} has ended, so none of its networks is the best: publish the "
            "last one without --best, or train on with an evaluator."
        )
    weights, test = _content(snapshots.best), _read(snapshots.best_card)
    # The learner writes the card first, and a copy of the run may come in between.
    if test.get("crc32", crc32(weights)) != crc32(weights):
        raise InputError(
            f"{snapshots.best} is not of the test in {snapshots.best_card}: {_WRITTEN_ANEW}."
        )
    with _decoding(snapshots.best):
        network = _network(weights, config)
    return network, {"snapshot": test, **_until(test, folder, config)}


def _network(weights: bytes, config: RunConfig) -> QNetwork:
    """Returns the network of the weights. Raises LookupError, TypeError or ValueError if they are
    damaged."""
    found = decode_network_file(weights)
    network = build_network(config, count_actions_of(config, found))
    set_weights(network, found)
    return network


@contextmanager
def _decoding(source: Path) -> Iterator[None]:
    try:
        yield
    except (LookupError, TypeError, ValueError) as error:
        raise InputError(f"{source} is damaged ({error}): {_WRITTEN_ANEW}.") from None


def _until(test: dict[str, Any], folder: RunFolder, config: RunConfig) -> dict[str, Any]:
    """Returns what the card says of the training until the best test's weights, not of all of the
    run. Raises InputError if the run does not tell it."""
    rows = EpochTable(folder.epochs).rows()
    for row in rows:
        if (row.epoch, row.phase) == (test.get("epoch"), "train"):
            return {
                "agent_steps": config.replay.learning_starts + row.total_train_steps,
                "updates": row.weight_updates,
                "wall_seconds": row.total_time,
            }
    raise InputError(
        f"{folder.epochs} lacks the epoch of {Snapshots(folder.snapshots).best_card}: put it back, "
        "or publish the last weights, without --best."
    )


def _content(file: Path) -> bytes:
    """Returns the content of ``file``. Raises InputError if there is none yet."""
    if not file.is_file():
        raise InputError(f"{file} does not exist: continue the run until it does.")
    return file.read_bytes()


def _read(file: Path) -> dict[str, Any]:
    """Returns the JSON object in ``file``. Raises InputError if there is none or it is damaged."""
    content = _content(file)
    try:
        found = json.loads(content)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise InputError(f"{file} is damaged: {_WRITTEN_ANEW}.")
    return found


def main() -> None:
    options = parse(Options, "learner.publish", sys.argv[1:])
    stop = threading.Event()
    on_signals(stop)
    publish(options, stop)
    print(f"wrote {options.output}.safetensors and {options.output}.json")


if __name__ == "__main__":
    exit_on_input_error(main)
