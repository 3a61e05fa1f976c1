"""The libraries of the C++ code here: each is compiled once for a user, kept, and loaded.

`python -m common.native.library` compiles them into this folder instead, for an image without a
compiler.
"""

import hashlib
import os
import shlex
import shutil
import signal
import stat
import subprocess
import tempfile
import time
from contextlib import suppress
from ctypes import CDLL, c_double, c_float, c_int, c_long, c_void_p
from functools import cache
from pathlib import Path
from typing import Literal, get_args

from common.process.output import visible

_HERE = Path(__file__).parent
_SOURCES = ("trunk.cpp", "adam.cpp", "quantile_huber.cpp")
_HEADERS = ("threads.h",)
_FLAGS = (
    *("-std=c++20", "-O3", "-ffp-contract=fast", "-fno-math-errno"),
    "-falign-loops=64",  # or the speed of a loop would depend on the code before it
    *("-shared", "-fPIC", "-pthread"),
)
InstructionSet = Literal["avx2", "avx512", "avx512_bf16"]
"""What a library computes by."""
_FLAGS_OF: dict[InstructionSet, tuple[str, ...]] = {
    "avx2": ("-march=x86-64-v3",),
    "avx512": ("-march=x86-64-v4",),
    "avx512_bf16": ("-march=x86-64-v4", "-mavx512bf16", "-DBFLOAT16"),
}
_COMPILERS = ("c++", "g++", "clang++")
_SECONDS = 300.0
"""Maximum time to compile, which takes three seconds on a free core."""
_VERSION_SECONDS = 10.0
_DIGEST = hashlib.sha256
_TEMPORARY = "compiling-"
_KEPT_SECONDS = 3_600.0
"""Age from which the folder of a compilation that was killed is removed."""

_ARGUMENTS = {
    "trunk_pixels": (c_void_p, c_void_p, c_long, c_int, c_int, c_int),
    "trunk_new": (),
    "trunk_free": (c_void_p,),
    "trunk_pack": (c_void_p, c_void_p, c_void_p, c_long, c_float, c_int),
    "trunk_forward": (c_void_p, c_void_p, c_long, c_int, c_void_p, c_int),
    "trunk_backward": (
        *(c_void_p, c_void_p, c_long, c_void_p, c_void_p, c_void_p),
        *(c_long, c_int),
    ),
    "adam_step": (*(c_void_p,) * 6, c_int, *(c_double,) * 5, c_int),
    "quantile_huber": (c_void_p, c_void_p, c_long, c_int, c_int, c_void_p, c_void_p, c_int),
}


def multiplies_bfloat16(instruction_set: InstructionSet) -> bool:
    """Returns whether its library multiplies bfloat16, and not float32."""
    return instruction_set == "avx512_bf16"


class NativeUnavailableError(Exception):
    """There is no compiled library; the text says why."""


@cache
def library(instruction_set: InstructionSet) -> CDLL:
    """Returns the library for ``instruction_set``, and compiles it if this user never did so with
    this compiler.

    Raises:
        NativeUnavailableError: there is no compiler, or it failed, or the file cannot be trusted.
    """
    try:
        loaded = CDLL(str(_whole(instruction_set)))
        for name, arguments in _ARGUMENTS.items():
            function = getattr(loaded, name)
            function.argtypes, function.restype = arguments, None
    # Such as a user without a home, or a compiler that makes something else.
    except (OSError, RuntimeError, AttributeError) as error:
        raise NativeUnavailableError(str(error)) from None
    loaded.trunk_new.restype = c_void_p
    return loaded


def _whole(instruction_set: InstructionSet) -> Path:
    """Returns the compiled file, and recompiles it if its digest is wrong: a damaged library could
    crash the process. Raises OSError or NativeUnavailableError."""
    path = _compiled(instruction_set)
    size = _DIGEST().digest_size
    content = path.read_bytes()
    if _DIGEST(content[:-size]).digest() == content[-size:]:
        return path
    if path.parent == _HERE:
        raise NativeUnavailableError(f"{path} is damaged: install the package again")
    path.unlink(missing_ok=True)
    return _compiled(instruction_set)


def _compiled(instruction_set: InstructionSet) -> Path:
    """Returns the compiled file. Raises OSError or NativeUnavailableError."""
    shipped = _HERE / _name(instruction_set)
    if shipped.exists():
        return shipped
    compiler = _compiler()
    path = _folder() / _name(instruction_set, _run([*compiler, "--version"], _VERSION_SECONDS))
    if not path.exists():
        _compile(compiler, instruction_set, path)
    _check_own(path)
    return path


def _name(instruction_set: InstructionSet, compiler: str = "") -> str:
    """Returns the name of what ``compiler``, by its version, makes of the present source."""
    code = [(_HERE / each).read_text() for each in (*_SOURCES, *_HEADERS)]
    told = "\n".join((*code, *_FLAGS, *_FLAGS_OF[instruction_set], compiler))
    return f"kernel-{instruction_set}-{hashlib.sha256(told.encode()).hexdigest()[:16]}.so"


def _compiler() -> list[str]:
    """Returns the compiler's command. Raises NativeUnavailableError if there is none."""
    compiler = os.environ.get("CXX", "").strip() or next(filter(shutil.which, _COMPILERS), None)
    if compiler is None:
        raise NativeUnavailableError("there is no C++ compiler here: install g++ or clang")
    try:
        return shlex.split(compiler)
    except ValueError as error:
        raise NativeUnavailableError(f"CXX is no command ({error})") from None


def _compile(compiler: list[str], instruction_set: InstructionSet, path: Path) -> None:
    """Makes the file at ``path``, whose last bytes are a digest of the others. Raises OSError or
    NativeUnavailableError."""
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=_TEMPORARY) as folder:
        made = Path(folder, path.name)
        flags = *_FLAGS, *_FLAGS_OF[instruction_set]
        sources = [str(_HERE / each) for each in _SOURCES]
        _run([*compiler, *flags, *sources, "-o", str(made)], _SECONDS)
        if not made.is_file():
            raise NativeUnavailableError(f"{compiler[0]} made no file")
        with made.open("rb+") as file:
            digest = _DIGEST(file.read()).digest()
            file.write(digest)
            file.flush()
            os.fsync(file.fileno())  # or a power loss after the renaming could leave half of it
        made.chmod(0o755)  # whatever the umask: only the user may write it, and all may load it
        made.rename(path)  # at once, or another process would load half of it


def _folder() -> Path:
    """Returns the folder of compiled files, which only this user may change."""
    caches = Path(os.environ.get("XDG_CACHE_HOME", ""))
    folder = (caches if caches.is_absolute() else Path.home() / ".cache") / "ale-robot"
    if not folder.is_absolute():
        raise NativeUnavailableError("HOME is not an absolute path")
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    _check_own(folder)
    for left in folder.glob(f"{_TEMPORARY}*"):
        with suppress(FileNotFoundError):  # another process was quicker
            if time.time() - left.stat().st_mtime > _KEPT_SECONDS:
                shutil.rmtree(left, ignore_errors=True)
    return folder


def _check_own(path: Path) -> None:
    """Refuses to run code that another user could have written. Raises NativeUnavailableError."""
    status = path.stat()
    if status.st_uid != os.geteuid() or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise NativeUnavailableError(
            f"{path} is not yours alone to write: remove it, or name a folder of your own by "
            "XDG_CACHE_HOME"
        )


def _run(command: list[str], seconds: float) -> str:
    """Returns what ``command`` prints. Raises NativeUnavailableError if it fails or takes longer
    than ``seconds``."""
    try:
        started = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            start_new_session=True,
        )
    except OSError as error:
        raise NativeUnavailableError(f"the compiler cannot run: {error}") from None
    with started:
        try:
            told, wrong = started.communicate(timeout=seconds)
        except BaseException as error:  # the programs that the compiler has started end, too
            os.killpg(started.pid, signal.SIGKILL)
            if not isinstance(error, subprocess.TimeoutExpired):
                raise
            raise NativeUnavailableError(
                f"{command[0]} did not end within {seconds:.0f} s"
            ) from None
    if started.returncode:
        first = next(iter(wrong.splitlines()), f"exit code {started.returncode}")
        raise NativeUnavailableError(f"{command[0]} cannot compile it: {visible(first)[:200]}")
    return told


if __name__ == "__main__":
    for _each in get_args(InstructionSet):
        _compile(_compiler(), _each, _HERE / _name(_each))
