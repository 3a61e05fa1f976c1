"""What is taken of a GPU, by a stand-in for CUDA."""

import pytest
import torch

from common.metrics import METRICS
from learner.telemetry.gpu_figures import gpu_figures

CUDA = torch.device("cuda")


@pytest.fixture
def gpu(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """A GPU of which 3 of 16 GB are in use."""

    def memory(device: torch.device) -> tuple[int, int]:
        assert device == CUDA
        return 13_000_000_000, 16_000_000_000

    monkeypatch.setattr(torch.cuda, "mem_get_info", memory)
    monkeypatch.setattr(torch.cuda, "utilization", {CUDA: 83}.__getitem__)
    return monkeypatch


@pytest.mark.usefixtures("gpu")
def test_memory_and_utilisation_of_the_gpu() -> None:
    found = gpu_figures(CUDA)
    assert found == {
        "run/gpu_memory_bytes": 3_000_000_000,
        "run/gpu_capacity_bytes": 16_000_000_000,
        "run/gpu_utilisation": 0.83,
    }
    assert found.keys() <= METRICS.keys()


@pytest.mark.parametrize("error", [ModuleNotFoundError("nvidia-ml-py"), RuntimeError("no driver")])
def test_a_utilisation_that_nobody_counts_is_unknown(
    gpu: pytest.MonkeyPatch, error: Exception
) -> None:
    def fails(device: torch.device) -> int:
        raise error

    gpu.setattr(torch.cuda, "utilization", fails)
    found = gpu_figures(CUDA)
    assert found["run/gpu_utilisation"] is None
    assert found["run/gpu_memory_bytes"] == 3_000_000_000


def test_without_cuda_nothing_is_asked_and_nothing_told(gpu: pytest.MonkeyPatch) -> None:
    gpu.setattr(torch.cuda, "mem_get_info", lambda device: pytest.fail("a CPU was asked"))
    assert gpu_figures(torch.device("cpu")) == {}
