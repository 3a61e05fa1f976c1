"""Where the native kernel can be tested."""

from typing import get_args

import pytest
import torch

from common.native.kernel import NEEDS, bfloat16_is_faster
from common.native.library import Instructions, NativeUnavailableError, _compiler


def _missing(instructions: Instructions) -> str:
    cpu = torch.cpu.get_capabilities()
    if lacks := [each for each in NEEDS[instructions] if not cpu.get(each)]:
        return f"this processor has no {lacks[0]}"
    try:
        _compiler()
    except NativeUnavailableError as error:
        return str(error)
    return ""  # a source that does not compile then fails the tests


def needs_native(instructions: Instructions) -> pytest.MarkDecorator:
    missing = _missing(instructions)
    return pytest.mark.skipif(bool(missing), reason=missing)


NEEDS_NATIVE = needs_native("avx512_bf16" if bfloat16_is_faster() else "avx2")
ALL_INSTRUCTIONS = [pytest.param(each, marks=needs_native(each)) for each in get_args(Instructions)]
