"""The network that a run begins with: fresh, or another run's, adapted to this run's input."""

from pathlib import Path

import torch

from common.errors import InputError
from common.network import QNetwork, build_network
from common.proprioception import VectorWidths, vector_widths
from common.protocol.weights import encode_weights
from common.registry import ENVIRONMENTS, ROBOTS
from common.run.folder import RunFolder
from common.run.network_file import load_network_file
from common.run.origin import origin_of
from common.settings.config import RunConfig
from common.settings.fit import check_fit
from learner.options import LearnerOptions


def first_network(options: LearnerOptions, folder: RunFolder) -> QNetwork:
    """Returns the network that a run begins with.

    If the run has a checkpoint, the weights come from there later.

    Raises:
        InputError: the network cannot be read, does not fit what the run plays, or is given to a
            run that began with another one.
    """
    given, config = options.initial, options.config
    kept = folder.initial if options.resume and folder.initial.exists() else None
    if given is None:
        found = None if folder.checkpoint.exists() else kept
        return _fresh(config) if found is None else read_network(found, config)
    # A service passes the same flags at the first start and at each restart.
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

    The vector observations of network and run may differ. Numbers that the network does not know,
    such as longer histories, get zero weights, so that it plays as before. Numbers that the run
    lacks, such as the joints of another robot, are dropped: the network has to learn without them.

    Raises:
        InputError: the file cannot be read, or the network does not fit what the run plays.
    """
    trained = origin_of(file)
    told = None if trained is None else _told_to_both(trained, config)
    check_fit(file, trained, config, vector=told is None)
    network = _fresh(config)
    if trained is None or told is None:
        load_network_file(network, file, "this run")
        return network
    found = _fresh(config, vector_width=trained.vector_width)
    load_network_file(found, file, "this run")
    weights = found.state_dict()
    of_found = weights["hidden.weight"]
    pixels = of_found.shape[1] - trained.vector_width
    hidden = torch.zeros_like(network.hidden.weight)
    hidden[:, :pixels] = of_found[:, :pixels]
    before, now = (pixels + torch.tensor(numbers, dtype=torch.int64) for numbers in told)
    hidden[:, now] = of_found[:, before]
    network.load_state_dict(weights | {"hidden.weight": hidden})
    return network


def _fresh(config: RunConfig, vector_width: int | None = None) -> QNetwork:
    return build_network(config, config.action_count, vector_width=vector_width)


def _told_to_both(trained: RunConfig, config: RunConfig) -> tuple[list[int], list[int]] | None:
    """Returns the indices of the numbers that both vector observations have: in the network's
    former one, and in the run's; None if the network cannot be adapted."""
    if not config.play.vector:
        return None
    if not trained.play.vector:
        return [], []
    widths = _widths(trained), _widths(config)
    if any(
        sum(each) != run.vector_width for each, run in zip(widths, (trained, config), strict=True)
    ):
        return None  # a registered environment with a vector of its own
    one_body = (trained.env, trained.play.robot) == (config.env, config.play.robot)
    before: list[int] = []
    now: list[int] = []
    ends = [0, 0]
    for group, *sizes in zip(VectorWidths._fields, *widths, strict=True):
        begins, ends = ends, [end + size for end, size in zip(ends, sizes, strict=True)]
        shared = min(sizes)
        if group == "joints" and not one_body:
            shared = 0
        # Histories end with the newest number, and a forecast begins with the nearest.
        old, new = begins if group == "forecast" else [end - shared for end in ends]
        before += range(old, old + shared)
        now += range(new, new + shared)
    return before, now


def _widths(config: RunConfig) -> VectorWidths:
    robot = ENVIRONMENTS.find(config.env).robot
    return vector_widths(config.play, ROBOTS.find(config.play.robot).joints if robot else 0)
