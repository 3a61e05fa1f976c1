"""A network's file: its weights, and the settings of their training."""

from pathlib import Path

import torch
from torch import nn

from common.errors import InputError, MessageError, cannot_read
from common.protocol.weights import NotSafetensors, encode_weights, load_weights
from common.regular_file import read_file
from common.run.origin import not_a_network, origin_metadata
from common.settings.config import RunConfig


def encode_network_file(
    network: nn.Module, trained: RunConfig, dtype: torch.dtype = torch.float32
) -> bytes:
    """Returns the file of ``network``, whose training had the settings ``trained``: safetensors of
    float32, or of float16 for a small file."""
    return encode_weights(network, origin_metadata(trained), dtype)


def load_network_file(network: nn.Module, file: Path, what: str) -> None:
    """Puts the weights in ``file``, which a person named, into ``network``. Raises InputError if
    the file cannot be read, or does not fit ``what`` the network is for."""
    try:
        load_weights(network, read_file(file))
    except OSError as error:
        raise cannot_read(file, error) from None
    except NotSafetensors as error:
        raise not_a_network(file, error) from None
    except MessageError as error:
        raise InputError(
            f"{file} does not fit {what} ({error}): put its card beside it, if it has one "
            f"({file.stem}.json), or choose what it was trained with by --env, --game, "
            "--play.minimal-actions, --play.vector and --learning.algorithm."
        ) from None
