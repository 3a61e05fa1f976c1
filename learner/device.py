"""The hardware that the network runs on, and the precision of its updates."""

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from common.errors import InputError
from common.metrics import Value
from common.native.kernel import (
    KernelChoice,
    PrecisionChoice,
    bfloat16_is_faster,
    choose_kernel,
)
from common.native.library import InstructionSet
from common.process.log_lines import say_aside

if TYPE_CHECKING:  # a command line is parsed without PyTorch
    import torch

    from common.network import QNetwork

DeviceChoice = Literal["auto", "cpu", "cuda"]


@dataclass(frozen=True)
class Device:
    """Where and how an update is computed."""

    torch: "torch.device"
    bfloat16: bool
    """Whether an update computes its layers in bfloat16."""
    graphs: bool = False
    """Whether an update is recorded as a CUDA graph, see `learner.algorithm.cuda_graph`."""
    native: InstructionSet | None = None
    """Instruction set by which `common.native` computes what it can of an update; None for PyTorch
    alone."""

    @property
    def precision(self) -> str:
        """What an update multiplies."""
        return "bfloat16" if self.bfloat16 else "float32"

    @property
    def name(self) -> str:
        """Device and precision for people: ``cpu (bfloat16)``."""
        return f"{self.torch.type} ({self.precision}{', native' if self.native else ''})"

    def figures(self) -> dict[str, Value]:
        """Returns memory and utilisation of the GPU, by all programs; nothing without CUDA.

        PyTorch knows the utilisation only if the optional package nvidia-ml-py is installed.
        """
        import torch

        if self.torch.type != "cuda":
            return {}
        free, total = torch.cuda.mem_get_info(self.torch)
        busy = None
        # The package is missing, or the driver or the GPU partition (MIG) does not measure it.
        with suppress(Exception):
            busy = torch.cuda.utilization(self.torch) / 100
        return {
            "run/gpu_memory_bytes": total - free,
            "run/gpu_capacity_bytes": total,
            "run/gpu_utilisation": busy,
        }


def choose_device(
    device: DeviceChoice,
    precision: PrecisionChoice,
    kernel: KernelChoice = "auto",
    *,
    network: "QNetwork | None" = None,
    graphs: bool = False,
) -> Device:
    """Returns the requested device; 'auto' takes CUDA if it is available.

    Precision 'auto' takes bfloat16 where it is faster: on a GPU that has it, with AMX, and where
    the compiled code multiplies it faster. A warning tells of bfloat16 that is only emulated.

    The kernel is chosen as `choose_kernel` does for ``network``, on a CPU.

    Raises:
        InputError: CUDA, its graphs or the compiled code was requested but is not available.
    """
    import torch

    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("there is no CUDA device here: use --device auto or cpu.")
    kind = "cuda" if device != "cpu" and torch.cuda.is_available() else "cpu"
    if graphs and kind == "cpu":
        raise InputError("--cuda-graphs needs a CUDA device: omit it.")
    if kind == "cuda":
        has = faster = torch.cuda.is_bf16_supported(including_emulation=False)
    else:
        cpu = torch.cpu.get_capabilities()
        has = bool(cpu.get("avx512_bf16") or cpu.get("amx_bf16"))
        faster = bool(cpu.get("amx_bf16")) or bfloat16_is_faster()
    if precision == "bfloat16" and not has:
        say_aside(
            f"warning: this {'GPU' if kind == 'cuda' else 'CPU'} only emulates bfloat16, slower "
            "than float32: omit --precision bfloat16.",
            "warning",
        )
    bfloat16 = faster if precision == "auto" else precision == "bfloat16"
    if kernel == "native" and kind != "cpu":
        raise InputError(
            "the native kernel computes on a CPU: omit --kernel native, or give --device cpu."
        )
    if kind == "cuda":
        return Device(torch.device(kind), bfloat16, graphs)
    compiled = choose_kernel(kernel, bfloat16=bfloat16, network=network)
    return Device(torch.device(kind), bfloat16, native=compiled)
