"""Where the native kernel can be tested."""

from typing import get_args

import pytest
import torch

from common.native.kernel import _NEEDS, fastest_numbers
from common.native.library import NativeUnavailableError, Numbers, _compiler


def _missing(numbers: Numbers) -> str:
    cpu = torch.cpu.get_capabilities()
    if lacks := [each for each in _NEEDS[numbers] if not cpu.get(each)]:
        return f"this processor has no {lacks[0]}"
    try:
        _compiler()
    except NativeUnavailableError as error:
        return str(error)
    return ""  # a source that does not compile then fails the tests


def needs_native(numbers: Numbers) -> pytest.MarkDecorator:
    missing = _missing(numbers)
    return pytest.mark.skipif(bool(missing), reason=missing)


NEEDS_NATIVE = needs_native(fastest_numbers())
EACH_NUMBERS = [pytest.param(each, marks=needs_native(each)) for each in get_args(Numbers)]
