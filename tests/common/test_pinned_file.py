"""Files that settings name with the hash of their content."""

import os
from dataclasses import asdict
from pathlib import Path

import pytest

from common import pinned_file
from common.errors import InputError
from common.pinned_file import path_of, pin, read
from common.settings.conditions import PlayConfig
from common.settings.config import RunConfig
from common.settings.stored_config import from_mapping

ABC = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
"""SHA-256 of "abc", from FIPS 180-2."""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "hand.npz"
    path.write_bytes(b"abc")
    return path


def test_a_name_gets_the_hash_of_the_content(file: Path) -> None:
    pinned = pin(str(file))
    assert pinned == f"{file}#sha256={ABC}"
    assert path_of(pinned) == path_of(str(file)) == file
    assert read(pinned) == read(str(file)) == b"abc"


def test_a_pinned_name_stays_as_it_is_wherever_the_file_is(file: Path) -> None:
    pinned = pin(str(file))
    file.unlink()
    assert pin(pinned) == pinned


def test_another_content_is_refused_with_both_hashes(file: Path) -> None:
    pinned = pin(str(file))
    file.write_bytes(b"abd")
    with pytest.raises(
        InputError, match=rf"is not the run's file: its SHA-256 is \w+, .*{ABC}: copy"
    ):
        read(pinned)
    assert read(str(file)) == b"abd"


def test_a_file_that_is_not_there(file: Path, tmp_path: Path) -> None:
    pinned = pin(str(file))
    file.unlink()
    with pytest.raises(InputError, match=r"cannot be read \(No such file.*: copy it there from"):
        read(pinned)
    with pytest.raises(InputError, match=r"cannot be read \(No such file.*: name a file"):
        pin(str(file))
    with pytest.raises(InputError, match=r"cannot be read \(Is a directory\)"):
        read(str(tmp_path))
    with pytest.raises(InputError, match=r"cannot be read \(embedded null .*\): name another"):
        read("a\0.npz")


def test_a_file_that_is_too_large(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pinned_file, "MAX_BYTES", 3)
    assert read(str(file)) == b"abc"
    file.write_bytes(b"abcd")
    with pytest.raises(InputError, match="is larger than 3 bytes"):
        read(str(file))


def test_a_path_that_no_process_could_read_from_the_settings(file: Path) -> None:
    longest = 200 - len("#sha256=") - 64
    folder = file.parent / ("d" * (longest - len(str(file.parent)) - 2 - len("a.npz")))
    folder.mkdir()
    for name, fits in (("a.npz", True), ("ab.npz", False)):
        (folder / name).write_bytes(b"abc")
        path = str(folder / name)
        assert len(path) == longest + (not fits)
        if fits:
            config = RunConfig(play=PlayConfig(robot=pin(path)))
            assert from_mapping(RunConfig, asdict(config)) == config
        else:
            with pytest.raises(InputError, match="is too long by 1 characters"):
                pin(path)


def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "hand.npz"
    os.mkfifo(pipe)
    with pytest.raises(InputError, match=r"hand\.npz cannot be read \(it is not a regular file\)"):
        pin(str(pipe))
