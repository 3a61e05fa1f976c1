"""The libraries of ``trunk.cpp``: each is compiled once for a user, kept, and loaded.

`python -m common.native.library` compiles them into this folder instead, for an image without a
compiler.
"""

import hashlib
import os
import shlex
import shutil
import stat
import subprocess
import tempfile
from ctypes import CDLL, c_float, c_int, c_long, c_void_p
from functools import cache
from pathlib import Path
from typing import Literal, get_args

_SOURCE = Path(__file__).with_name("trunk.cpp")
_FLAGS = ("-std=c++20", "-O3", "-ffp-contract=fast", "-shared", "-fPIC", "-pthread")
InstructionSet = Literal["avx2", "avx512", "avx512_bf16"]
"""What a library computes by. The last one multiplies bfloat16, the others float32."""
_FLAGS_OF: dict[InstructionSet, tuple[str, ...]] = {
    "avx2": ("-march=x86-64-v3",),
    "avx512": ("-march=x86-64-v4",),
    "avx512_bf16": ("-march=x86-64-v4", "-mavx512bf16", "-DBFLOAT16"),
}
_COMPILERS = ("c++", "g++", "clang++")
_SECONDS = 300
"""Maximum time to compile, which takes three seconds on a free core."""

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
}


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
        loaded = _loaded(instruction_set)
    except (OSError, RuntimeError) as error:  # such as a user without a home
        raise NativeUnavailableError(str(error)) from None
    for name, arguments in _ARGUMENTS.items():
        function = getattr(loaded, name)
        function.argtypes, function.restype = arguments, None
    loaded.trunk_new.restype = c_void_p
    return loaded


def _loaded(instruction_set: InstructionSet) -> CDLL:
    """Returns the compiled file as a library; one that a full disk has damaged is made anew. Raises
    OSError or NativeUnavailableError."""
    path = _compiled(instruction_set)
    try:
        return CDLL(str(path))
    except OSError:
        if path.parent == _SOURCE.parent:
            raise
        path.unlink()
        return CDLL(str(_compiled(instruction_set)))


def _compiled(instruction_set: InstructionSet) -> Path:
    """Returns the compiled file. Raises OSError or NativeUnavailableError."""
    shipped = _SOURCE.with_name(_name(instruction_set))
    if shipped.exists():
        return shipped
    compiler = _compiler()
    path = _folder() / _name(instruction_set, _run([*compiler, "--version"]))
    if not path.exists():
        _compile(compiler, instruction_set, path)
    _check_own(path)
    return path


def _name(instruction_set: InstructionSet, compiler: str = "") -> str:
    """Returns the name of what ``compiler``, by its version, makes of the present source."""
    told = "\n".join((_SOURCE.read_text(), *_FLAGS, *_FLAGS_OF[instruction_set], compiler))
    return f"trunk-{instruction_set}-{hashlib.sha256(told.encode()).hexdigest()[:16]}.so"


def _compiler() -> list[str]:
    """Returns the compiler's command. Raises NativeUnavailableError if there is none."""
    compiler = os.environ.get("CXX") or next(filter(shutil.which, _COMPILERS), None)
    if compiler is None:
        raise NativeUnavailableError("there is no C++ compiler here: install g++ or clang")
    return shlex.split(compiler)


def _compile(compiler: list[str], instruction_set: InstructionSet, path: Path) -> None:
    """Makes the file at ``path``. Raises OSError or NativeUnavailableError."""
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        made = Path(folder, path.name)
        _run([*compiler, *_FLAGS, *_FLAGS_OF[instruction_set], str(_SOURCE), "-o", str(made)])
        made.chmod(0o755)  # whatever the umask: only the user may write it, and all may load it
        made.rename(path)  # at once, or another process would load half of it


def _folder() -> Path:
    """Returns the folder of compiled files, which only this user may change."""
    caches = Path(os.environ.get("XDG_CACHE_HOME", ""))
    folder = (caches if caches.is_absolute() else Path.home() / ".cache") / "ale-robot"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    _check_own(folder)
    return folder


def _check_own(path: Path) -> None:
    """Refuses to run code that another user could have written. Raises NativeUnavailableError."""
    status = path.stat()
    if status.st_uid != os.geteuid() or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise NativeUnavailableError(
            f"{path} is not yours alone to write: remove it, or name a folder of your own by "
            "XDG_CACHE_HOME"
        )


def _run(command: list[str]) -> str:
    """Returns what ``command`` prints. Raises NativeUnavailableError if it fails."""
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=_SECONDS
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NativeUnavailableError(f"the compiler cannot run: {error}") from None
    if done.returncode:
        first = next(iter(done.stderr.splitlines()), f"exit code {done.returncode}")
        raise NativeUnavailableError(f"{command[0]} cannot compile it: {first}")
    return done.stdout


if __name__ == "__main__":
    for _each in get_args(InstructionSet):
        _compile(_compiler(), _each, _SOURCE.with_name(_name(_each)))
