"""The network that a run begins with: fresh, or another's, with the run's own proprioception."""

from pathlib import Path

import torch

from common.errors import InputError
from common.network import QNetwork, build_network
from common.proprioception import vector_width
from common.protocol.weights import encode_weights, load_weights_file
from common.run.config import RunConfig
from common.run.folder import RunFolder
from common.run.origin import check_fit, origin_of
from learner.options import LearnerOptions


def first_network(options: LearnerOptions, folder: RunFolder) -> QNetwork:
    """Returns the network that a run begins with; one that has a checkpoint takes its weights from
    there.

    Raises:
        InputError: it cannot be read, is not for what the run plays, or is given to a run that
            began with another one.
    """
    given, config = options.initial, options.config
    kept = folder.initial if options.resume and folder.initial.exists() else None
    if given is None:
        found = None if folder.checkpoint.exists() else kept
        return _fresh(config) if found is None else read_network(found, config)
    # The same flags may start a run and go on with it, as a service's do.
    network = read_network(given, config)
    other = kept is not None and (
        encode_weights(read_network(kept, config)) != encode_weights(network)
    )
    if other or (kept is None and options.resume and folder.has_begun):
        raise InputError(
            f"the run in {folder.path} did not begin with {given}: omit --initial, or name another "
            "run."
        )
    return network


def read_network(file: Path, config: RunConfig) -> QNetwork:
    """Returns the network in ``file`` for a run of ``config``.

    Where the run's vector observation has more numbers than the network's, the new ones get zero
    weights, so that it plays as before. Where it has fewer, such as no joints, or those of another
    robot, the network has to learn to do without.

    Raises:
        InputError: it cannot be read, or is not for what the run plays.
    """
    trained = origin_of(file)
    shared = None if trained is None else _shared_numbers(trained, config)
    check_fit(file, trained, config, vector=shared is None)
    network = _fresh(config)
    if trained is None or shared is None:
        load_weights_file(network, file, "this run")
        return network
    found = _fresh(config, vector_width=trained.vector_width)
    load_weights_file(found, file, "this run")
    weights = found.state_dict()
    of_found = weights["hidden.weight"]
    alike = of_found.shape[1] - trained.vector_width + shared
    hidden = torch.zeros_like(network.hidden.weight)
    hidden[:, :alike] = of_found[:, :alike]
    network.load_state_dict(weights | {"hidden.weight": hidden})
    return network


def _fresh(config: RunConfig, vector_width: int | None = None) -> QNetwork:
    return build_network(config, config.action_count, vector_width=vector_width)


def _shared_numbers(trained: RunConfig, config: RunConfig) -> int | None:
    """Returns how many numbers at the beginning of the vector observation mean the same in both;
    None where a network cannot go from one to the other."""
    old, new = trained.play, config.play
    if not new.vector:
        return None
    if not old.vector:
        return 0
    lengths = [(play.vector_commands, play.vector_key_frames) for play in (old, new)]
    if lengths[0] != lengths[1]:
        return None
    one_body = (trained.env, old.robot) == (config.env, new.robot)
    widths = trained.vector_width, config.vector_width
    return min(widths) if one_body else min(*widths, vector_width(new, joints=0))
