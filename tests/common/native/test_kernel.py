"""When the compiled code is used, on processors of all kinds."""

import pytest
import torch

from common.errors import InputError
from common.native import kernel as module
from common.native.kernel import KernelChoice, choose_kernel
from common.native.library import NativeUnavailableError
from common.network import QNetwork
from common.run.config import LearningConfig


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Stands for a library that is there, and tells how often it was asked for."""
    found: list[str] = []
    monkeypatch.setattr(module, "library", lambda: found.append("library"))
    return found


@pytest.mark.parametrize(
    ("has", "kernel", "used"),
    [
        ({"avx512_bf16"}, "auto", True),
        ({"avx512_bf16"}, "native", True),
        ({"avx512_bf16"}, "torch", False),
        ({"avx512_bf16", "amx_bf16"}, "auto", False),
        ({"avx512_bf16", "amx_bf16"}, "native", True),
        ({"avx2"}, "auto", False),
    ],
)
def test_auto_takes_it_where_it_is_faster(
    has: set[str],
    kernel: KernelChoice,
    used: bool,
    calls: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: dict.fromkeys(has, True))
    assert choose_kernel(kernel) is used
    assert len(calls) == used  # nothing is compiled in vain


def test_other_networks_are_pytorchs(calls: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx512_bf16": True})
    small = QNetwork(6, learning=LearningConfig(network="nips"))
    assert not choose_kernel("auto", small)
    with pytest.raises(InputError, match=r"for --learning\.network nature with four frames"):
        choose_kernel("native", small)
    assert calls == []
    assert choose_kernel("auto", QNetwork(6))


def test_a_processor_that_cannot_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx2": True})
    with pytest.raises(InputError, match="no AVX-512 bf16: omit --kernel native"):
        choose_kernel("native")


def test_without_a_compiler_auto_warns_and_goes_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing() -> None:
        raise NativeUnavailableError("there is no C++ compiler here: install g++ or clang")

    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx512_bf16": True})
    monkeypatch.setattr(module, "library", missing)
    assert not choose_kernel("auto")
    assert "warning: " in (told := capsys.readouterr().err)
    assert "install g++ or clang" in told
    with pytest.raises(InputError, match="is not available: there is no C"):
        choose_kernel("native")
