"""Which hardware and which precision are chosen, and what is taken of a GPU, without that
hardware."""

import pytest
import torch

from common.errors import InputError
from common.metrics import METRICS
from common.native.kernel import NEEDS, PrecisionChoice
from common.native.library import InstructionSet
from common.network import QNetwork
from common.settings.config import LearningConfig
from learner.device import Device, choose_device
from tests.native import INSTRUCTION_SETS

GPU = Device(torch.device("cuda"), bfloat16=True)


@pytest.mark.parametrize(
    ("capability", "precision", "bfloat16"),
    [
        ((7, 5), "auto", False),  # a T4 computes it in float32, after turning every number over
        ((7, 5), "bfloat16", True),
        ((9, 0), "auto", True),
        ((9, 0), "float32", False),
    ],
)
def test_bfloat16_is_chosen_by_itself_where_a_gpu_has_it(
    capability: tuple[int, int],
    precision: PrecisionChoice,
    bfloat16: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def supported(including_emulation: bool = True) -> bool:
        return including_emulation or capability[0] >= 8

    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", supported)
    assert choose_device("auto", precision).bfloat16 is bfloat16
    assert choose_device("auto", precision).torch == torch.device("cuda")


@pytest.mark.parametrize(
    ("has", "precision", "told"),
    [
        ("avx512_bf16", "bfloat16", ""),
        ("amx_bf16", "bfloat16", ""),
        (
            "avx2",
            "bfloat16",
            "warning: this CPU only emulates bfloat16, slower than float32: omit --precision",
        ),
        ("avx2", "auto", ""),
        ("avx2", "float32", ""),
    ],
)
def test_bfloat16_that_a_processor_only_emulates_is_warned_of(
    has: str,
    precision: PrecisionChoice,
    told: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {has: True})
    assert choose_device("cpu", precision).bfloat16 is (precision == "bfloat16")
    assert capsys.readouterr().err[: len(told) or None] == told


@pytest.mark.parametrize(
    ("cpu", "bfloat16"),
    [
        ({"avx512_bf16": True, "cpu_name": "AMD EPYC"}, True),
        ({"avx512_bf16": True, "cpu_name": "Intel Xeon"}, False),
        ({"avx512_bf16": True, "amx_bf16": True, "cpu_name": "Intel Xeon"}, True),
        ({"avx2": True}, False),
    ],
)
def test_auto_takes_bfloat16_where_it_is_faster(
    cpu: dict[str, object], bfloat16: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: cpu)
    assert choose_device("cpu", "auto").bfloat16 is bfloat16


def test_the_native_kernel_is_for_a_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda *, including_emulation: True)
    with pytest.raises(InputError, match="on a CPU: omit --kernel native"):
        choose_device("cuda", "bfloat16", "native")
    assert not choose_device("cuda", "bfloat16", "auto").native


@pytest.mark.parametrize("instruction_set", INSTRUCTION_SETS)
def test_the_native_kernel_is_taken_unless_another_is_asked_for(
    instruction_set: InstructionSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    cpu = dict.fromkeys(NEEDS[instruction_set], True)
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: cpu)
    small = QNetwork(6, learning=LearningConfig(network="nips"))
    assert choose_device("cpu", "auto").native == instruction_set
    precision = "bfloat16" if instruction_set == "avx512_bf16" else "float32"
    assert choose_device("cpu", "auto", network=QNetwork(6)).name == f"cpu ({precision}, native)"
    assert choose_device("cpu", "auto", "torch").native is None
    assert choose_device("cpu", "auto", network=small).native is None
    float32 = choose_device("cpu", "float32", "native")  # on any of them
    assert not float32.bfloat16
    assert float32.native == ("avx2" if instruction_set == "avx2" else "avx512")


def test_a_gpu_that_only_emulates_bfloat16_is_called_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda *, including_emulation: False)
    assert choose_device("cuda", "bfloat16").bfloat16
    assert capsys.readouterr().err.startswith("warning: this GPU only emulates bfloat16")


@pytest.fixture
def gpu(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """A GPU of which 3 of 16 GB are in use."""

    def memory(device: torch.device) -> tuple[int, int]:
        assert device == GPU.torch
        return 13_000_000_000, 16_000_000_000

    monkeypatch.setattr(torch.cuda, "mem_get_info", memory)
    monkeypatch.setattr(torch.cuda, "utilization", {GPU.torch: 83}.__getitem__)
    return monkeypatch


@pytest.mark.usefixtures("gpu")
def test_memory_and_utilisation_of_the_gpu() -> None:
    found = GPU.figures()
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
    found = GPU.figures()
    assert found["run/gpu_utilisation"] is None
    assert found["run/gpu_memory_bytes"] == 3_000_000_000


def test_without_cuda_nothing_is_asked_and_nothing_told(gpu: pytest.MonkeyPatch) -> None:
    gpu.setattr(torch.cuda, "mem_get_info", lambda device: pytest.fail("a CPU was asked"))
    assert Device(torch.device("cpu"), bfloat16=False).figures() == {}
