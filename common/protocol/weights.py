"""Network weights as bytes (safetensors), on the wire and in files, checked before use."""

from collections.abc import Mapping, Sequence

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor, nn

from common.errors import MessageError


def encode_weights(
    network: nn.Module,
    metadata: Mapping[str, str] | None = None,
    dtype: torch.dtype = torch.float32,
) -> bytes:
    """Returns all weights of ``network``, as safetensors of float32, or of float16 for small files.

    Args:
        metadata: what a file tells beside them; messages carry none.
    """
    # safetensors needs plain strides, but the network is channels-last.
    weights = {name: v.to(dtype).contiguous() for name, v in network.state_dict().items()}
    return save(weights, None if metadata is None else dict(metadata))


class NotSafetensors(MessageError):
    """The bytes are not the weights of any network."""


def load_weights(network: nn.Module, payload: bytes) -> None:
    """Puts the weights in ``payload`` into ``network``: `decode_weights`, then `set_weights`, whose
    errors it raises."""
    set_weights(network, decode_weights(payload))


def decode_weights(payload: bytes) -> dict[str, Tensor]:
    """Returns the weights in ``payload``. Raises NotSafetensors if it holds none."""
    try:
        return load(payload)
    except (SafetensorError, ValueError, KeyError, TypeError, RuntimeError) as error:
        raise NotSafetensors(f"not safetensors: {error}") from None


def set_weights(network: nn.Module, found: Mapping[str, Tensor]) -> None:
    """Puts weights into ``network``, all or none; float16 is accepted for float32. Raises
    MessageError if names, shapes or types are not the network's, or a weight is not finite."""
    expected = network.state_dict()
    if found.keys() != expected.keys():
        raise MessageError(f"weights {sorted(found.keys() ^ expected.keys())} differ in name")
    for name, value in found.items():
        if value.shape != expected[name].shape or value.dtype not in (
            expected[name].dtype,
            torch.float16,
        ):
            raise MessageError(
                f"{name} is {value.dtype} {list(value.shape)} where the network has "
                f"{expected[name].dtype} {list(expected[name].shape)}"
            )
        if not are_finite([value]):
            raise MessageError(f"{name} holds a value that is not finite")
    network.load_state_dict(found)


def are_finite(weights: Sequence[Tensor]) -> bool:
    """Returns whether all numbers of ``weights`` are finite.

    The sums are checked first, which is twenty times as fast and waits for the device once. The
    numbers themselves are checked only if a sum is not finite, because it may have overflowed.
    """
    sums = torch.stack([each.sum(dtype=torch.float32) for each in weights])
    return bool(sums.isfinite().all()) or all(bool(each.isfinite().all()) for each in weights)
