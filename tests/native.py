"""Where the native kernel can be tested."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import get_args

import pytest
import torch

from common.native.kernel import NEEDS, bfloat16_is_faster
from common.native.library import InstructionSet, NativeUnavailableError, _compiler


def _missing(instruction_set: InstructionSet) -> str:
    cpu = torch.cpu.get_capabilities()
    if lacks := [each for each in NEEDS[instruction_set] if not cpu.get(each)]:
        return f"this processor has no {lacks[0]}"
    try:
        _compiler()
    except NativeUnavailableError as error:
        return str(error)
    return ""  # a source that does not compile then fails the tests


def needs_native(instruction_set: InstructionSet) -> pytest.MarkDecorator:
    missing = _missing(instruction_set)
    return pytest.mark.skipif(bool(missing), reason=missing)


NEEDS_NATIVE = needs_native("avx512_bf16" if bfloat16_is_faster() else "avx2")
INSTRUCTION_SETS = [
    pytest.param(each, marks=needs_native(each)) for each in get_args(InstructionSet)
]


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """PyTorch, and the kernel with it, computes with so many threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
