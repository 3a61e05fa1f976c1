"""Whether the compiled code is used: for an update, and for a training actor's forward passes."""

from typing import Literal

from common.errors import InputError
from common.native.library import NativeUnavailableError, library
from common.process.log_lines import say_aside

KernelChoice = Literal["auto", "torch", "native"]


def choose_kernel(kernel: KernelChoice) -> bool:
    """Returns whether to use the compiled code, which is then there.

    'auto' takes it where it is faster: on a processor that multiplies vectors of bfloat16, but not
    tiles of it (AMX), for which PyTorch has good code. A warning tells if it cannot be compiled
    there.

    Raises:
        InputError: it was asked for but is not available.
    """
    import torch  # late: a command line is parsed without it

    cpu = torch.cpu.get_capabilities()
    asked = kernel == "native"
    if asked and not cpu.get("avx512_bf16"):
        raise InputError("this processor has no AVX-512 bf16: omit --kernel native.")
    if not (asked or (kernel == "auto" and cpu.get("avx512_bf16") and not cpu.get("amx_bf16"))):
        return False
    try:
        library()
    except NativeUnavailableError as error:
        if asked:
            raise InputError(f"the native kernel is not available: {error}.") from None
        say_aside(f"warning: runs could be half as long, but {error}.", "warning")
        return False
    return True
