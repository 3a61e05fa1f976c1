"""Whether the compiled code is used: for an update, and for a training actor's forward passes."""

from typing import TYPE_CHECKING, Literal

from common.errors import InputError
from common.native.library import NativeUnavailableError, Numbers, library
from common.process.log_lines import say_aside

if TYPE_CHECKING:
    from common.network import QNetwork

# PyTorch is imported only where it is asked, so that help and wrong flags are answered at once.

KernelChoice = Literal["auto", "torch", "native"]
_AVX512 = ("avx512_f", "avx512_bw", "avx512_cd", "avx512_dq", "avx512_vl")
_NEEDS: dict[Numbers, tuple[str, ...]] = {
    "float32": _AVX512,
    "bfloat16": (*_AVX512, "avx512_bf16"),
}
_NAMES: dict[Numbers, str] = {"float32": "AVX-512", "bfloat16": "AVX-512 bf16"}


def fastest_numbers() -> Numbers:
    """Returns what the compiled code multiplies faster here.

    That is bfloat16 on AMD's processors with AVX-512 bf16. Intel's take twice the time for that
    instruction that they take for the two of float32 which it stands for (benchmarks/LOG.md).
    """
    import torch

    cpu = torch.cpu.get_capabilities()
    intel = str(cpu.get("cpu_name", "")).startswith("Intel")
    return "bfloat16" if cpu.get("avx512_bf16") and not intel else "float32"


def choose_kernel(
    kernel: KernelChoice, numbers: Numbers, network: "QNetwork | None" = None
) -> bool:
    """Returns whether to use the compiled code for ``numbers``, which is then there, for
    ``network``; None stands for one with the usual layers.

    'auto' takes it where it is faster: on a processor with AVX-512, but not for bfloat16 on one
    that multiplies tiles of it (AMX), for which PyTorch has good code. A warning tells if it cannot
    be compiled there.

    Raises:
        InputError: it was asked for but cannot be used.
    """
    import torch

    from common.native.network import NativeQNetwork

    cpu = torch.cpu.get_capabilities()
    asked, can = kernel == "native", all(cpu.get(each) for each in _NEEDS[numbers])
    fits = network is None or NativeQNetwork.fits(network)
    if asked and not can:
        raise InputError(f"this processor has no {_NAMES[numbers]}: omit --kernel native.")
    if asked and not fits:
        raise InputError(
            "the native kernel is for --learning.network nature with four frames: omit --kernel "
            "native."
        )
    faster = can and fits and not (numbers == "bfloat16" and cpu.get("amx_bf16"))
    if not (asked or (kernel == "auto" and faster)):
        return False
    try:
        library(numbers)
    except NativeUnavailableError as error:
        if asked:
            raise InputError(f"the native kernel is not available: {error}.") from None
        say_aside(f"warning: PyTorch computes, which is slower here, because {error}.", "warning")
        return False
    return True
