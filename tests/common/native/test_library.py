"""When the library is compiled, and what is told if it cannot be."""

import os
import platform
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import get_args

import pytest

from common.native import library as module
from common.native.library import InstructionSet, NativeUnavailableError, library
from tests.patience import wait_until

_COMPILER = """#!/bin/sh
echo "$@" >> "$(dirname "$0")/calls"
if [ "$1" = --version ]; then echo "compiler 1.0"; exit 0; fi
for last; do :; done
cp "$(dirname "$0")/made" "$last" 2>/dev/null || { echo "it does not compile" >&2; exit 1; }
"""


_NEEDS_COMPILER = pytest.mark.skipif(
    platform.machine() != "x86_64" or not any(map(shutil.which, module._COMPILERS)),
    reason="needs a C++ compiler for x86-64",
)


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


def package(parent: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a package with a copy of the code, which the module takes for its own."""
    folder = parent / "package"
    folder.mkdir(parents=True)
    for file in (*module._SOURCES, *module._HEADERS):
        (folder / file).write_bytes(Path(module.__file__).with_name(file).read_bytes())
    monkeypatch.setattr(module, "_HERE", folder)
    return folder


def builds(compiler: Path) -> int:
    return sum("-o" in line for line in compiler.with_name("calls").read_text().splitlines())


def test_the_file_is_compiled_once_and_is_the_users_own(compiler: Path) -> None:
    compiler.with_name("made").write_text("code")
    first, second = module._compiled("avx512_bf16"), module._compiled("avx512_bf16")
    assert first == second
    assert first.read_bytes().startswith(b"code")
    assert builds(compiler) == 1
    assert first.parent.stat().st_mode & 0o077 == 0
    assert [each.name for each in first.parent.iterdir()] == [first.name]


def test_a_file_that_is_there_is_a_whole_one(compiler: Path) -> None:
    """Another process would load what is still written."""
    compiler.with_name("made").write_text("code")
    caches = compiler.with_name("caches") / "ale-robot"
    looks = f"ls {caches}/*.so >> {compiler.with_name('seen')} 2>/dev/null || true\n"
    compiler.write_text(_COMPILER.replace("cp ", f"{looks}cp ") + looks)
    module._compiled("avx512_bf16")
    assert compiler.with_name("seen").read_text() == ""


def test_other_flags_are_compiled_anew(compiler: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler.with_name("made").write_text("code")
    paths = {module._compiled("avx2")}
    monkeypatch.setattr(module, "_FLAGS", (*module._FLAGS, "-g"))
    paths.add(module._compiled("avx2"))
    assert len(paths) == builds(compiler) == 2


@pytest.mark.parametrize("kept", [0, 20, -1])
def test_a_damaged_file_is_made_anew(compiler: Path, kept: int) -> None:
    compiler.with_name("made").write_text("code of some length")
    path = module._whole("avx512_bf16")
    whole = path.read_bytes()
    path.write_bytes(whole[:kept] + b"\0" * (20 if kept == 20 else 0))
    assert module._whole("avx512_bf16") == path
    assert path.read_bytes() == whole
    assert builds(compiler) == 2


def test_a_damaged_file_of_the_package_is_told_and_kept(
    compiler: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shipped = package(tmp_path, monkeypatch) / module._name("avx512_bf16")
    shipped.write_text("half")
    with pytest.raises(NativeUnavailableError, match="is damaged: install the package again"):
        library("avx512_bf16")
    assert shipped.exists()


def test_what_a_killed_compilation_left_is_removed_in_time(compiler: Path) -> None:
    compiler.with_name("made").write_text("code")
    folder = module._folder()
    old, recent = (folder / f"{module._TEMPORARY}{age}" for age in ("old", "recent"))
    for left in (old, recent):
        left.mkdir()
        (left / "kernel.so").touch()
    os.utime(old, (0, 0))
    module._compiled("avx512_bf16")
    assert not old.exists()
    assert recent.exists()


def test_other_instructions_another_source_or_compiler_is_compiled_anew(
    compiler: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiler.with_name("made").write_text("code")
    paths = {module._compiled("avx512_bf16")}
    files = *module._SOURCES, *module._HEADERS
    for number, file in enumerate(files):
        (package(tmp_path / str(number), monkeypatch) / file).write_text("another")
        paths.add(module._compiled("avx512_bf16"))
    compiler.write_text(_COMPILER.replace("1.0", "2.0"))
    paths |= {module._compiled("avx512_bf16"), module._compiled("avx2")}
    assert len(paths) == builds(compiler) == len(files) + 3


def test_a_shipped_file_needs_no_compiler(
    compiler: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiler.with_name("made").write_text("code")
    folder = package(tmp_path, monkeypatch)
    shipped = folder / module._name("avx512_bf16")
    module._compile(module._compiler(), "avx512_bf16", shipped)
    monkeypatch.setenv("CXX", "/nowhere/compiler")
    assert module._compiled("avx512_bf16") == shipped
    (folder / "trunk.cpp").write_text("changed")  # the former file is not that of this source
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


@pytest.mark.parametrize(
    ("compiler_command", "told"),
    [
        ("g++ '", r"CXX is no command \(No closing quotation\)"),
        ("true", "true made no file"),
        ("/nowhere/compiler", r"cannot run: .*nowhere"),
    ],
)
def test_a_compiler_that_is_none_is_told(
    compiler_command: str, told: str, compiler: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CXX", compiler_command)
    with pytest.raises(NativeUnavailableError, match=told):
        library("avx512_bf16")


def test_a_blank_compiler_is_the_usual_one(compiler: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CXX", " ")
    monkeypatch.setenv("PATH", str(compiler.parent))
    compiler.rename(compiler.with_name("c++"))
    assert module._compiler() == ["c++"]


def test_a_compilers_control_characters_do_not_reach_the_terminal(compiler: Path) -> None:
    compiler.write_text(_COMPILER.replace("it does not compile", r"\033[2Jno \001" + 500 * "x"))
    with pytest.raises(NativeUnavailableError) as told:
        library("avx512_bf16")
    assert str(told.value).isprintable()
    assert str(told.value).count("x") <= 200 + str(compiler).count("x")


def _living_groups() -> set[str]:
    """Returns the process groups that have a process which is no zombie."""
    groups = set()
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has just ended
            state, _, group = (process / "stat").read_text().rpartition(") ")[2].split()[:3]
            groups |= {group} if state != "Z" else set()
    return groups


def test_a_compiler_that_hangs_ends_with_the_programs_that_it_started(
    compiler: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_SECONDS", 0.5)
    # It reads what people type, if it can, and waits for a program that holds its output open.
    hangs = 'read -r line && exit 0; echo $$ > "$(dirname "$0")/pid"; sleep 1000 | cat\n'
    compiler.write_text(_COMPILER.replace("for last;", f"{hangs}for last;"))
    with pytest.raises(NativeUnavailableError, match=r"did not end within 0 s"):
        library("avx512_bf16")
    group = compiler.with_name("pid").read_text().strip()
    wait_until(lambda: group not in _living_groups(), "the programs of the compiler have ended")


def test_a_compiler_may_have_arguments(compiler: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler.with_name("made").write_text("code")
    monkeypatch.setenv("CXX", f"env {compiler}")
    assert module._compiled("avx512_bf16").read_bytes().startswith(b"code")


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
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    monkeypatch.setenv("HOME", "here")
    with pytest.raises(NativeUnavailableError, match="HOME is not an absolute path"):
        library("avx512_bf16")


@_NEEDS_COMPILER
@pytest.mark.parametrize("instruction_set", get_args(InstructionSet))
def test_the_source_compiles(instruction_set: InstructionSet, tmp_path: Path) -> None:
    """Also where the processor cannot run it."""
    module._compile(module._compiler(), instruction_set, tmp_path / "kernel.so")
    assert (tmp_path / "kernel.so").stat().st_size > 10_000


@pytest.mark.skipif(shutil.which("objdump") is None, reason="needs objdump, of binutils")
@_NEEDS_COMPILER
@pytest.mark.parametrize(
    ("instruction_set", "wide", "rounds"),
    [("avx2", False, False), ("avx512", True, False), ("avx512_bf16", True, True)],
)
def test_it_has_no_instructions_beyond_its_set(
    instruction_set: InstructionSet, wide: bool, rounds: bool, tmp_path: Path
) -> None:
    """They would end the process on the processors that it is for."""
    module._compile(module._compiler(), instruction_set, tmp_path / "kernel.so")
    told = subprocess.run(
        ["objdump", "-d", "--no-show-raw-insn", tmp_path / "kernel.so"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert "vfmadd" in told or rounds
    assert ("%zmm" in told) is wide
    assert ("%k1" in told) is wide
    assert ("vdpbf16ps" in told) is rounds


def test_a_file_that_is_no_library_is_told(compiler: Path) -> None:
    compiler.with_name("made").write_text("code")
    with pytest.raises(NativeUnavailableError, match=r"kernel-.*: "):
        library("avx512_bf16")


@_NEEDS_COMPILER
def test_a_library_of_something_else_is_told(compiler: Path, tmp_path: Path) -> None:
    source = tmp_path / "other.cpp"
    source.write_text("int other;")
    command = ["c++", "-shared", "-fPIC", str(source), "-o", str(compiler.with_name("made"))]
    subprocess.run(command, check=True)
    with pytest.raises(NativeUnavailableError, match="undefined symbol: trunk_pixels"):
        library("avx512_bf16")
