"""A network's file: its weights, and the settings of their training."""

from pathlib import Path

import torch
from torch import Tensor, nn

from common.errors import InputError, MessageError, cannot_read
from common.protocol.weights import NotSafetensors, decode_weights, encode_weights, set_weights
from common.regular_file import read_file
from common.run.origin import not_a_network, origin_metadata
from common.settings.config import RunConfig


def encode_network_file(
    network: nn.Module,
    trained: RunConfig,
    dtype: torch.dtype = torch.float32,
    identity: str | None = None,
) -> bytes:
    """Returns the file of ``network``, whose training had the settings ``trained``: safetensors of
    float32, or of float16 for a small file.

    Args:
        identity: see `origin_metadata`.
    """
    return encode_weights(network, origin_metadata(trained, identity), dtype)


_PUBLISHED = ("average.", "online.")
"""Prefixes, in a learner's checkpoint, of the weights that actors got; the first one that exists
counts."""


def _published(found: dict[str, Tensor]) -> dict[str, Tensor]:
    """Returns, from a checkpoint's tensors, the weights that actors got; plain weights as they
    are."""
    for prefix in _PUBLISHED:
        if any(name.startswith(prefix) for name in found):
            return {n.removeprefix(prefix): v for n, v in found.items() if n.startswith(prefix)}
    return found


def decode_network_file(content: bytes) -> dict[str, Tensor]:
    """Returns the weights in a network's file; in a learner's checkpoint, those that it published.
    Raises NotSafetensors if it holds no weights."""
    return _published(decode_weights(content))


def load_network_file(network: nn.Module, file: Path, what: str) -> None:
    """Puts the weights in ``file``, which a person named, into ``network``. Raises InputError if
    the file cannot be read, or does not fit ``what`` the network is for."""
    try:
        set_weights(network, decode_network_file(read_file(file)))
    except OSError as error:
        raise cannot_read(file, error) from None
    except NotSafetensors as error:
        raise not_a_network(file, error) from None
    except MessageError as error:
        raise InputError(
            f"{file} does not fit {what} ({error}): choose what it was trained with by --env, "
            "--game, --play.minimal-actions, --play.vector and --learning.algorithm, or put the "
            f"card of an older file, {file.stem}.json, beside it."
        ) from None
