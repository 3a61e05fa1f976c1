"""What a run takes of the GPU on which its network learns."""

import torch

from common.metrics import Value


def gpu_figures(device: torch.device) -> dict[str, Value]:
    """Returns memory and utilisation of ``device``, by all programs; nothing unless it is CUDA.

    PyTorch tells the utilisation only where the package nvidia-ml-py is installed, which this
    program does without.
    """
    if device.type != "cuda":
        return {}
    free, total = torch.cuda.mem_get_info(device)
    return {
        "run/gpu_memory_bytes": total - free,
        "run/gpu_capacity_bytes": total,
        "run/gpu_utilisation": _utilisation(device),
    }


def _utilisation(device: torch.device) -> float | None:
    try:
        return torch.cuda.utilization(device) / 100
    except Exception:  # no package, or a driver or a part of a GPU (MIG) that does not count it
        return None
