"""Chooses whether compiled code or PyTorch computes updates and a training actor's passes."""

from typing import TYPE_CHECKING, Literal

from common.errors import InputError
from common.native.library import (
    InstructionSet,
    NativeUnavailableError,
    library,
    multiplies_bfloat16,
)
from common.process.log_lines import say_aside

if TYPE_CHECKING:
    from common.network import QNetwork

# PyTorch is imported only where it is asked, so that help and wrong flags are answered at once.

KernelChoice = Literal["auto", "torch", "native"]
PrecisionChoice = Literal["auto", "float32", "bfloat16"]
_AVX2 = ("avx2", "bmi", "bmi2", "f16c", "fma3", "lzcnt")
_AVX512 = (*_AVX2, "avx512_f", "avx512_bw", "avx512_cd", "avx512_dq", "avx512_vl")
NEEDS: dict[InstructionSet, tuple[str, ...]] = {
    "avx512_bf16": (*_AVX512, "avx512_bf16"),
    "avx512": _AVX512,
    "avx2": _AVX2,
}
"""What a processor must have for each, as PyTorch names it; those with wider vectors come first."""


def instruction_sets() -> list[InstructionSet]:
    """Returns what this processor can compute by, those with wider vectors first."""
    import torch

    cpu = torch.cpu.get_capabilities()
    return [each for each, needs in NEEDS.items() if all(map(cpu.get, needs))]


def bfloat16_is_faster() -> bool:
    """Returns whether the compiled code multiplies bfloat16 faster than float32 here.

    True on every processor with AVX-512 bf16 except Intel's. There, one bfloat16 instruction takes
    twice as long as the two float32 instructions that it replaces. PyTorch, too, computes float32
    faster on those without AMX (benchmarks/LOG.md).
    """
    import torch

    cpu = torch.cpu.get_capabilities()
    intel = str(cpu.get("cpu_name", "")).startswith("Intel")
    return bool(cpu.get("avx512_bf16")) and not intel


def choose_kernel(
    kernel: KernelChoice, *, bfloat16: bool, network: "QNetwork | None" = None
) -> InstructionSet | None:
    """Returns the instruction set of the compiled code, which is then there; or None, for PyTorch.

    'auto' takes it where it is faster: on any x86 processor with AVX2, but not for bfloat16 on one
    that multiplies tiles of it (AMX), for which PyTorch has good code. A warning tells if it cannot
    be compiled there.

    Args:
        kernel: what was asked for.
        bfloat16: whether bfloat16 is to be multiplied, and not float32.
        network: the network to compute; None for one with the usual layers.

    Raises:
        InputError: it was asked for but cannot be used.
    """
    import torch

    from common.native.network import NativeQNetwork

    if kernel == "torch":
        return None
    asked = kernel == "native"
    able = (each for each in instruction_sets() if multiplies_bfloat16(each) is bfloat16)
    found = next(able, None)
    fits = network is None or NativeQNetwork.fits(network)
    slower = bfloat16 and torch.cpu.get_capabilities().get("amx_bf16")
    if not asked and (found is None or not fits or slower):
        return None
    if found is None:
        lacks, omit = (
            ("AVX-512 bf16", "--precision bfloat16") if bfloat16 else ("AVX2", "--kernel native")
        )
        raise InputError(f"this processor has no {lacks}: omit {omit}.")
    if not fits:
        raise InputError(
            "the native kernel is for --learning.network nature with four frames: omit --kernel "
            "native."
        )
    try:
        library(found)
    except NativeUnavailableError as error:
        if asked:
            raise InputError(f"the native kernel is not available: {error}.") from None
        say_aside(f"warning: PyTorch computes, which is slower here, because {error}.", "warning")
        return None
    return found
