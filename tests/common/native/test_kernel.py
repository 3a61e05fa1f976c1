"""When the compiled code is used, on processors of all kinds."""

import pytest
import torch

from common.errors import InputError
from common.native import kernel as module
from common.native.kernel import _NEEDS, KernelChoice, choose_kernel, fastest_numbers
from common.native.library import NativeUnavailableError, Numbers
from common.network import QNetwork
from common.run.config import LearningConfig

_WIDE = dict.fromkeys(_NEEDS["float32"], True)
_ALL = dict.fromkeys(_NEEDS["bfloat16"], True)


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Stands for libraries that are there, and tells which were asked for."""
    found: list[str] = []
    monkeypatch.setattr(module, "library", found.append)
    return found


@pytest.mark.parametrize(
    ("has", "numbers", "kernel", "used"),
    [
        (_ALL, "bfloat16", "auto", True),
        (_ALL, "bfloat16", "native", True),
        (_ALL, "bfloat16", "torch", False),
        (_ALL | {"amx_bf16": True}, "bfloat16", "auto", False),
        (_ALL | {"amx_bf16": True}, "bfloat16", "native", True),
        (_ALL | {"amx_bf16": True}, "float32", "auto", True),
        (_WIDE, "float32", "auto", True),
        (_WIDE, "float32", "native", True),
        (_WIDE, "float32", "torch", False),
        (_WIDE, "bfloat16", "auto", False),
        ({"avx512_f": True}, "float32", "auto", False),
        ({"avx2": True}, "float32", "auto", False),
    ],
)
def test_auto_takes_it_where_it_is_faster(
    has: dict[str, bool],
    numbers: Numbers,
    kernel: KernelChoice,
    used: bool,
    calls: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: has)
    assert choose_kernel(kernel, numbers) is used
    assert calls == [numbers] * used  # nothing is compiled in vain


@pytest.mark.parametrize(
    ("cpu", "numbers"),
    [
        (_ALL | {"cpu_name": "AMD EPYC"}, "bfloat16"),
        (_ALL, "bfloat16"),
        (_ALL | {"cpu_name": "Intel Xeon"}, "float32"),
        (_WIDE | {"cpu_name": "AMD EPYC"}, "float32"),
        ({}, "float32"),
    ],
)
def test_bfloat16_is_faster_where_its_instruction_is(
    cpu: dict[str, object], numbers: Numbers, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: cpu)
    assert fastest_numbers() == numbers


def test_other_networks_are_pytorchs(calls: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: _ALL)
    small = QNetwork(6, learning=LearningConfig(network="nips"))
    assert not choose_kernel("auto", "float32", small)
    with pytest.raises(InputError, match=r"for --learning\.network nature with four frames"):
        choose_kernel("native", "float32", small)
    assert calls == []
    assert choose_kernel("auto", "float32", QNetwork(6))


def test_a_processor_that_cannot_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx2": True})
    with pytest.raises(InputError, match="no AVX-512: omit --kernel native"):
        choose_kernel("native", "float32")
    with pytest.raises(InputError, match="no AVX-512 bf16: omit --kernel native"):
        choose_kernel("native", "bfloat16")


def test_without_a_compiler_auto_warns_and_goes_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(numbers: Numbers) -> None:
        raise NativeUnavailableError("there is no C++ compiler here: install g++ or clang")

    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: _ALL)
    monkeypatch.setattr(module, "library", missing)
    assert not choose_kernel("auto", "bfloat16")
    assert "warning: " in (told := capsys.readouterr().err)
    assert "install g++ or clang" in told
    with pytest.raises(InputError, match="is not available: there is no C"):
        choose_kernel("native", "bfloat16")
