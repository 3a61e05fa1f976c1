"""When the library is compiled, and what is told if it cannot be."""

import os
import platform
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest

from common.native import library as module
from common.native.library import InstructionSet, NativeUnavailableError, library

_COMPILER = """#!/bin/sh
echo "$@" >> "$(dirname "$0")/calls"
if [ "$1" = --version ]; then echo "compiler 1.0"; exit 0; fi
for last; do :; done
cp "$(dirname "$0")/made" "$last" 2>/dev/null || { echo "it does not compile" >&2; exit 1; }
"""


@pytest.fixture
def compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A compiler that gives a file `made`, or fails without it, and writes down its calls."""
    compiler = tmp_path / "compiler"
    compiler.write_text(_COMPILER)
    compiler.chmod(0o755)
    monkeypatch.setenv("CXX", str(compiler))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    library.cache_clear()
    yield compiler
    library.cache_clear()


def builds(compiler: Path) -> int:
    return sum("-o" in line for line in compiler.with_name("calls").read_text().splitlines())


def test_the_file_is_compiled_once_and_is_the_users_own(compiler: Path) -> None:
    compiler.with_name("made").write_text("code")
    first, second = module._compiled("avx512_bf16"), module._compiled("avx512_bf16")
    assert first == second
    assert first.read_text() == "code"
    assert builds(compiler) == 1
    assert first.parent.stat().st_mode & 0o077 == 0
    assert [each.name for each in first.parent.iterdir()] == [first.name]


def test_other_instructions_another_source_or_compiler_is_compiled_anew(
    compiler: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiler.with_name("made").write_text("code")
    paths = {module._compiled("avx512_bf16")}
    changed = tmp_path / "trunk.cpp"
    changed.write_text("another")
    monkeypatch.setattr(module, "_SOURCE", changed)
    paths.add(module._compiled("avx512_bf16"))
    compiler.write_text(_COMPILER.replace("1.0", "2.0"))
    paths |= {module._compiled("avx512_bf16"), module._compiled("avx2")}
    assert len(paths) == builds(compiler) == 4


def test_a_shipped_file_needs_no_compiler(
    compiler: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiler.with_name("made").write_text("code")
    source = tmp_path / "package" / "trunk.cpp"
    source.parent.mkdir()
    source.write_text("source")
    monkeypatch.setattr(module, "_SOURCE", source)
    shipped = source.with_name(module._name("avx512_bf16"))
    module._compile(module._compiler(), "avx512_bf16", shipped)
    monkeypatch.setenv("CXX", "/nowhere/compiler")
    assert module._compiled("avx512_bf16") == shipped
    source.write_text("changed")  # the former file is not that of this source
    with pytest.raises(NativeUnavailableError, match="cannot run"):
        module._compiled("avx512_bf16")


def test_an_error_of_the_compiler_is_told_and_leaves_nothing(
    compiler: Path, tmp_path: Path
) -> None:
    with pytest.raises(NativeUnavailableError, match="cannot compile it: it does not compile"):
        library("avx512_bf16")
    assert list((tmp_path / "caches" / "ale-robot").iterdir()) == []


def test_without_a_compiler_it_is_told_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    library.cache_clear()
    with pytest.raises(NativeUnavailableError, match=r"install g\+\+ or clang"):
        library("avx512_bf16")


def test_a_compiler_that_is_not_there_is_told(
    compiler: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CXX", "/nowhere/compiler")
    with pytest.raises(NativeUnavailableError, match=r"cannot run: .*nowhere"):
        library("avx512_bf16")


@pytest.mark.parametrize("which", ["file", "folder"])
@pytest.mark.parametrize("mode", [0o720, 0o702])
def test_code_that_others_may_write_is_not_run(compiler: Path, which: str, mode: int) -> None:
    compiler.with_name("made").write_text("code")
    path = module._compiled("avx512_bf16")
    (path if which == "file" else path.parent).chmod(mode)
    with pytest.raises(NativeUnavailableError, match="is not yours alone to write"):
        library("avx512_bf16")


def test_code_of_another_user_is_not_run(compiler: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler.with_name("made").write_text("code")
    module._compiled("avx512_bf16")
    other = os.geteuid() + 1
    monkeypatch.setattr(os, "geteuid", lambda: other)
    with pytest.raises(NativeUnavailableError, match="is not yours alone to write"):
        library("avx512_bf16")


@pytest.mark.parametrize("mask", [0o002, 0o077])
def test_the_umask_does_not_decide_who_may_write_it(compiler: Path, mask: int) -> None:
    made = compiler.with_name("made")
    made.write_text("code")
    made.chmod(0o775)
    before = os.umask(mask)
    try:
        assert module._compiled("avx512_bf16").stat().st_mode & 0o777 == 0o755
    finally:
        os.umask(before)


def test_a_compiler_may_have_arguments(compiler: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler.with_name("made").write_text("code")
    monkeypatch.setenv("CXX", f"env {compiler}")
    assert module._compiled("avx512_bf16").read_text() == "code"


@pytest.mark.parametrize("caches", ["", "relative"])
def test_without_a_folder_for_caches_it_is_in_the_users_own(
    compiler: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caches: str
) -> None:
    compiler.with_name("made").write_text("code")
    monkeypatch.setenv("XDG_CACHE_HOME", caches)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert module._compiled("avx512_bf16").parent == tmp_path / "home" / ".cache" / "ale-robot"


def test_a_home_that_cannot_be_written_is_told(
    compiler: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(NativeUnavailableError, match="Not a directory"):
        library("avx512_bf16")


@pytest.mark.skipif(
    platform.machine() != "x86_64" or not any(map(shutil.which, module._COMPILERS)),
    reason="needs a C++ compiler for x86-64",
)
@pytest.mark.parametrize("instruction_set", get_args(InstructionSet))
def test_the_source_compiles(instruction_set: InstructionSet, tmp_path: Path) -> None:
    """Also where the processor cannot run it."""
    module._compile(module._compiler(), instruction_set, tmp_path / "trunk.so")
    assert (tmp_path / "trunk.so").stat().st_size > 10_000


def test_a_file_that_is_no_library_is_made_anew_once_and_told(compiler: Path) -> None:
    compiler.with_name("made").write_text("code")
    module._compiled("avx512_bf16")
    with pytest.raises(NativeUnavailableError, match=r"trunk-.*: "):
        library("avx512_bf16")
    assert builds(compiler) == 2
