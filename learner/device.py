"""Which hardware the network runs on, and in which precision."""

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from common.errors import InputError
from common.metrics import Value

if TYPE_CHECKING:  # a command line is read without PyTorch
    import torch

DeviceChoice = Literal["auto", "cpu", "cuda"]
PrecisionChoice = Literal["auto", "float32", "bfloat16"]


@dataclass(frozen=True)
class Device:
    """Where to compute."""

    torch: "torch.device"
    bfloat16: bool
    """Whether an update computes its layers in that precision."""
    graphs: bool = False
    """Whether it is recorded as a CUDA graph, see `learner.algorithm.cuda_graph`."""

    @property
    def name(self) -> str:
        """For people: ``cpu (bfloat16)``."""
        return f"{self.torch.type} ({'bfloat16' if self.bfloat16 else 'float32'})"

    def figures(self) -> dict[str, Value]:
        """Returns memory and utilisation of the GPU, by all programs; nothing unless it is CUDA.

        PyTorch tells the utilisation only where the package nvidia-ml-py is installed, which this
        program does without.
        """
        import torch

        if self.torch.type != "cuda":
            return {}
        free, total = torch.cuda.mem_get_info(self.torch)
        busy = None
        # Without the package, or with a driver or a part of a GPU (MIG) that does not count it.
        with suppress(Exception):
            busy = torch.cuda.utilization(self.torch) / 100
        return {
            "run/gpu_memory_bytes": total - free,
            "run/gpu_capacity_bytes": total,
            "run/gpu_utilisation": busy,
        }


def choose_device(
    device: DeviceChoice, precision: PrecisionChoice, *, graphs: bool = False
) -> Device:
    """Returns the device asked for; 'auto' takes CUDA where there is one, and elsewhere ``graphs``
    are none.

    bfloat16 is chosen by itself where the processor multiplies it natively: there an update takes
    half the time.

    Raises:
        InputError: CUDA was asked for and there is none.
    """
    import torch

    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("there is no CUDA device here: use --device auto or cpu.")
    kind = "cuda" if device != "cpu" and torch.cuda.is_available() else "cpu"
    if precision == "auto":
        cpu = torch.cpu.get_capabilities()
        native = (
            torch.cuda.is_bf16_supported(including_emulation=False)
            if kind == "cuda"
            else bool(cpu.get("avx512_bf16") or cpu.get("amx_bf16"))
        )
    else:
        native = precision == "bfloat16"
    return Device(torch.device(kind), native, graphs and kind == "cuda")
