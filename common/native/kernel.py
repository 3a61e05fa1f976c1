"""Whether the compiled code is used: for an update, and for a training actor's forward passes."""

from typing import TYPE_CHECKING, Literal

from common.errors import InputError
from common.native.library import NativeUnavailableError, library
from common.process.log_lines import say_aside

if TYPE_CHECKING:
    from common.network import QNetwork

# PyTorch is imported only where it is asked, so that help and wrong flags are answered at once.

KernelChoice = Literal["auto", "torch", "native"]


def choose_kernel(kernel: KernelChoice, network: "QNetwork | None" = None) -> bool:
    """Returns whether to use the compiled code, which is then there, for ``network``; None stands
    for one with the usual layers.

    'auto' takes it where it is faster: on a processor that multiplies vectors of bfloat16, but not
    tiles of it (AMX), for which PyTorch has good code. A warning tells if it cannot be compiled
    there.

    Raises:
        InputError: it was asked for but cannot be used.
    """
    import torch

    from common.native.network import NativeQNetwork

    cpu = torch.cpu.get_capabilities()
    asked, can = kernel == "native", bool(cpu.get("avx512_bf16"))
    fits = network is None or NativeQNetwork.fits(network)
    if asked and not can:
        raise InputError("this processor has no AVX-512 bf16: omit --kernel native.")
    if asked and not fits:
        raise InputError(
            "the native kernel is for --learning.network nature with four frames: omit --kernel "
            "native."
        )
    if not (asked or (kernel == "auto" and can and fits and not cpu.get("amx_bf16"))):
        return False
    try:
        library()
    except NativeUnavailableError as error:
        if asked:
            raise InputError(f"the native kernel is not available: {error}.") from None
        say_aside(f"warning: PyTorch computes, which is slower here, because {error}.", "warning")
        return False
    return True
