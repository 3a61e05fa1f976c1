"""Where the native kernel can be tested."""

import pytest
import torch

from common.native.library import NativeUnavailableError, _compiler


def _missing() -> str:
    if not torch.cpu.get_capabilities().get("avx512_bf16"):
        return "this processor has no AVX-512 bf16"
    try:
        _compiler()
    except NativeUnavailableError as error:
        return str(error)
    return ""  # a source that does not compile then fails the tests


_MISSING = _missing()
NEEDS_NATIVE = pytest.mark.skipif(bool(_MISSING), reason=_MISSING)
