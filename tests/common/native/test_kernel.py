"""When the compiled code is used, on processors of all kinds."""

import pytest
import torch

from common.errors import InputError
from common.native import kernel as module
from common.native.kernel import KernelChoice, bfloat16_is_faster, choose_kernel
from common.native.library import InstructionSet, NativeUnavailableError
from common.network import QNetwork
from common.settings.config import LearningConfig

_V3 = ("avx2", "bmi", "bmi2", "f16c", "fma3", "lzcnt")
_V4 = (*_V3, "avx512_f", "avx512_bw", "avx512_cd", "avx512_dq", "avx512_vl")
_AVX2, _AVX512 = dict.fromkeys(_V3, True), dict.fromkeys(_V4, True)
_BF16 = _AVX512 | {"avx512_bf16": True}
_AMX = _BF16 | {"amx_bf16": True}


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Stands for libraries that are there, and tells which were asked for."""
    found: list[str] = []
    monkeypatch.setattr(module, "library", found.append)
    return found


@pytest.mark.parametrize(
    ("has", "bfloat16", "kernel", "used"),
    [
        (_BF16, True, "auto", "avx512_bf16"),
        (_BF16, True, "native", "avx512_bf16"),
        (_BF16, True, "torch", None),
        (_BF16, False, "auto", "avx512"),
        (_AMX, True, "auto", None),
        (_AMX, True, "native", "avx512_bf16"),
        (_AMX, False, "auto", "avx512"),
        (_AVX512, False, "auto", "avx512"),
        (_AVX512, False, "native", "avx512"),
        (_AVX512, False, "torch", None),
        (_AVX512, True, "auto", None),
        (_AVX2 | {"avx512_f": True}, False, "auto", "avx2"),
        (_AVX2, False, "native", "avx2"),
        (_AVX2, True, "auto", None),
        ({"avx2": True}, False, "auto", None),
        ({"neon": True}, False, "auto", None),
    ],
)
def test_auto_takes_it_where_it_is_faster(
    has: dict[str, bool],
    bfloat16: bool,
    kernel: KernelChoice,
    used: InstructionSet | None,
    calls: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: has)
    assert choose_kernel(kernel, bfloat16=bfloat16) == used
    assert calls == ([used] if used else [])  # nothing is compiled in vain


@pytest.mark.parametrize("lacks", _V4)
def test_each_extension_of_the_compilers_level_is_asked_for(
    lacks: str, calls: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """-march=x86-64-v3 and -v4 let the compiler use all of them."""
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: _BF16 | {lacks: False})
    assert choose_kernel("auto", bfloat16=True) is None
    assert choose_kernel("auto", bfloat16=False) == (None if lacks in _V3 else "avx2")


@pytest.mark.parametrize(
    ("cpu", "faster"),
    [
        (_BF16 | {"cpu_name": "AMD EPYC"}, True),
        (_BF16, True),
        (_BF16 | {"cpu_name": "Intel Xeon"}, False),
        (_AVX512 | {"cpu_name": "AMD EPYC"}, False),
        ({}, False),
    ],
)
def test_bfloat16_is_faster_where_its_instruction_is(
    cpu: dict[str, object], faster: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: cpu)
    assert bfloat16_is_faster() is faster


def test_other_networks_are_pytorchs(calls: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: _BF16)
    small = QNetwork(6, learning=LearningConfig(network="nips"))
    assert choose_kernel("auto", bfloat16=True, network=small) is None
    with pytest.raises(InputError, match=r"for --learning\.network nature with four frames"):
        choose_kernel("native", bfloat16=True, network=small)
    assert calls == []
    assert choose_kernel("auto", bfloat16=True, network=QNetwork(6))


@pytest.mark.parametrize(
    ("bfloat16", "told"),
    [
        (True, "no AVX-512 bf16: omit --precision bfloat16"),
        (False, "no AVX2: omit --kernel native"),
    ],
)
def test_a_processor_that_cannot_is_told(
    bfloat16: bool, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx": True})
    with pytest.raises(InputError, match=told):
        choose_kernel("native", bfloat16=bfloat16)


def test_without_a_compiler_auto_warns_and_goes_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(instruction_set: InstructionSet) -> None:
        raise NativeUnavailableError("there is no C++ compiler here: install g++ or clang")

    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: _BF16)
    monkeypatch.setattr(module, "library", missing)
    assert choose_kernel("auto", bfloat16=True) is None
    assert "warning: " in (told := capsys.readouterr().err)
    assert "install g++ or clang" in told
    with pytest.raises(InputError, match="is not available: there is no C"):
        choose_kernel("native", bfloat16=True)
