"""`python -m learner.evaluation.publish_policy runs/NAME -o policies/NAME`: a trained network to
give away.

Writes NAME.safetensors, the weights in float16, and NAME.json, its card: the run's configuration,
how long it was trained, and every game's score of an evaluation of just these weights.
`python -m actors --play --weights policies/NAME.safetensors` plays them.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import torch
import tyro
from safetensors.torch import load

from benchmarks.lab.evaluation import evaluate
from common.errors import InputError, exit_on_input_error
from common.network import build_network
from common.protocol.weights import encode_weights, load_weights
from common.run.folder import RunFolder, write_atomically

_OF_THE_RUN = (
    "run",
    "agent_steps",
    "updates",
    "wall_seconds",
    "random_reward",
    "machine",
    "git_commit",
    "config",
)


@dataclass(frozen=True)
class Options:
    """Make a policy of a run's best test, or of its last weights, and evaluate it."""

    run: tyro.conf.Positional[Path]
    """Folder of the run."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Both files, without their suffixes."""
    last: bool = False
    """Of the last weights instead of the best test's."""
    games: int = 30
    """Games of the evaluation."""
    epsilon: float = 0.001
    """Share of random decisions in it."""


def publish(options: Options) -> dict[str, Any]:
    """Write both files; the card.

    Raises:
        InputError: the run has no such weights, or they cannot be evaluated.
    """
    folder = RunFolder(options.run.parent, options.run.name)
    source = folder.checkpoint if options.last else folder.snapshots / "best.safetensors"
    for file in (source, folder.summary):
        if not file.is_file():
            raise InputError(f"{file} is not there: let the run go on until it is.")
    config = folder.stored_config()
    if config is None:
        raise InputError(f"{folder.config_file} is not there: name the folder of a run.")
    payload = source.read_bytes()
    actions = next(len(v) for k, v in load(payload).items() if k.endswith("actions.bias"))
    network = build_network(config, actions)
    load_weights(network, payload)
    summary = json.loads(folder.summary.read_bytes())
    card = {name: summary[name] for name in _OF_THE_RUN}
    if not options.last:
        card["snapshot"] = json.loads((folder.snapshots / "best.json").read_bytes())
    options.output.parent.mkdir(parents=True, exist_ok=True)
    weights = options.output.with_name(f"{options.output.name}.safetensors")
    write_atomically(weights, encode_weights(network, torch.float16))
    _write(options.output, card)
    card["evaluation"] = evaluate(weights, options.games, options.epsilon)
    _write(options.output, card)
    return card


def _write(output: Path, card: dict[str, Any]) -> None:
    file = output.with_name(f"{output.name}.json")
    write_atomically(file, (json.dumps(card, indent=2) + "\n").encode())


def main() -> None:
    options = tyro.cli(Options, prog="python -m learner.evaluation.publish_policy")
    publish(options)
    print(f"wrote {options.output}.safetensors and {options.output}.json")


if __name__ == "__main__":
    exit_on_input_error(main)
