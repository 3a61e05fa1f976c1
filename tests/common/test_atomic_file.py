"""Files that are written whole or not at all."""

import errno
import os
import shutil
from pathlib import Path

import pytest

from common.atomic_file import append_whole, check_new_file, write_atomically
from common.errors import InputError
from tests.full_disk import let_the_disk_take


def test_a_file_is_replaced_and_nothing_else_is_left(tmp_path: Path) -> None:
    path = tmp_path / "file"
    for content in (b"old", b"", b"new" * 1_000):
        write_atomically(path, content)
        assert path.read_bytes() == content
        assert os.listdir(tmp_path) == ["file"]


def test_a_write_that_fails_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "file"
    write_atomically(path, b"old")

    def full(descriptor: int) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="no space left"):
        write_atomically(path, b"new")
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["file"]


def test_a_disk_that_is_full_names_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    let_the_disk_take(monkeypatch)
    with pytest.raises(OSError, match="No space left") as raised:
        append_whole(tmp_path / "file", b"more")
    assert raised.value.filename == str(tmp_path / "file")
    monkeypatch.setattr(os, "fsync", lambda file: os.write(file, b""))
    with pytest.raises(OSError, match="No space left") as raised:
        write_atomically(tmp_path / "other", b"new")
    assert raised.value.filename == str(tmp_path / "other")


def test_a_name_that_cannot_be_replaced_leaves_no_file_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.mkdir()
    with pytest.raises(OSError, match="file"):
        write_atomically(path, b"new")
    assert os.listdir(tmp_path) == ["file"]


def test_a_disk_without_links_keeps_the_former_content_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_links(source: Path, target: Path) -> None:
        raise PermissionError(errno.EPERM, os.strerror(errno.EPERM))

    monkeypatch.setattr(os, "link", no_links)
    path, former = tmp_path / "file", tmp_path / "former"
    for content in (b"first", b"second", b"third"):
        write_atomically(path, content, former)
    assert (path.read_bytes(), former.read_bytes()) == (b"third", b"second")
    assert sorted(os.listdir(tmp_path)) == ["file", "former"]

    def full(source: Path, target: Path, *, follow_symlinks: bool) -> None:
        target.write_bytes(source.read_bytes()[:2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(shutil, "copyfile", full)
    with pytest.raises(OSError, match="No space left"):
        write_atomically(path, b"fourth", former)
    assert (path.read_bytes(), former.read_bytes()) == (b"third", b"second")
    assert sorted(os.listdir(tmp_path)) == ["file", "former"]


def test_what_is_appended_is_there_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "table"
    append_whole(path, b"first\n")
    with monkeypatch.context() as patched:
        let_the_disk_take(patched, 3, 1)
        with pytest.raises(OSError, match="No space"):
            append_whole(path, b"second\n")
    assert path.read_bytes() == b"first\n"

    def full(file: int) -> None:
        raise OSError(errno.EDQUOT, os.strerror(errno.EDQUOT))

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        with pytest.raises(OSError, match="quota"):
            append_whole(path, b"second\n", durable=True)
    assert path.read_bytes() == b"first\n"
    append_whole(path, b"second\n", durable=True)
    assert path.read_bytes() == b"first\nsecond\n"


def test_the_name_is_on_the_disk_as_well_as_the_content(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced = []

    def sync(descriptor: int) -> None:
        found = {each.name: each.read_bytes() for each in tmp_path.iterdir()}
        synced.append((os.readlink(f"/proc/self/fd/{descriptor}"), found))

    monkeypatch.setattr(os, "fsync", sync)
    write_atomically(tmp_path / "file", b"new")
    assert synced == [
        (f"{tmp_path}/file.tmp", {"file.tmp": b"new"}),
        (f"{tmp_path}", {"file": b"new"}),
    ]
    (tmp_path / "file").unlink()
    synced.clear()
    table = tmp_path / "table"
    for row in (b"1", b"2"):
        append_whole(table, row, durable=True)
    append_whole(table, b"3")
    assert synced == [
        (f"{table}", {"table": b"1"}),
        (f"{tmp_path}", {"table": b"1"}),
        (f"{table}", {"table": b"12"}),
    ]


def test_a_killed_process_leaves_the_old_or_the_new_file_at_every_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, replace, seen = tmp_path / "file", os.replace, []

    def watched(source: Path, target: Path) -> None:
        replace(source, target)
        seen.append(path.read_bytes())

    write_atomically(path, b"old")
    monkeypatch.setattr(os, "replace", watched)
    write_atomically(path, b"new", tmp_path / "former")
    assert seen == [b"old", b"new"]


def test_no_file_stays_open(tmp_path: Path) -> None:
    write_atomically(tmp_path / "file", b"new")
    append_whole(tmp_path / "table", b"row\n")
    opened = [os.path.realpath(each) for each in Path("/proc/self/fd").iterdir()]
    assert not [file for file in opened if file.startswith(str(tmp_path))]


def test_the_first_content_has_no_former(tmp_path: Path) -> None:
    write_atomically(tmp_path / "file", b"first", tmp_path / "former")
    assert os.listdir(tmp_path) == ["file"]


def test_whoever_holds_the_old_file_open_reads_it_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "file"
    write_atomically(path, b"old content")
    with path.open("rb", buffering=0) as reader:
        assert reader.read(3) == b"old"
        write_atomically(path, b"new")
        assert reader.read() == b" content"


def test_a_file_that_cannot_be_written_is_refused_before_it_is_needed(tmp_path: Path) -> None:
    check_new_file(tmp_path / "new.json")
    with pytest.raises(InputError, match="is a folder"):
        check_new_file(tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"new\.json cannot be written \(Not a directory\): name"):
        check_new_file(tmp_path / "file" / "none" / "new.json")


def test_a_device_a_pipe_and_a_link_are_not_replaced(tmp_path: Path) -> None:
    """As root, `--json /dev/stdout` took the terminal's name from the whole machine."""
    pipe, link = tmp_path / "pipe", tmp_path / "link"
    os.mkfifo(pipe)
    link.symlink_to("/dev/stdout")
    for file in (pipe, link, Path("/dev/null")):
        with pytest.raises(InputError, match=f"{file} is not a regular file: name one"):
            check_new_file(file)


def test_what_a_killed_process_left_beside_a_file_is_in_nobodys_way(tmp_path: Path) -> None:
    path, former = tmp_path / "file", tmp_path / "former"
    for name, content in (("file", "1"), ("file.tmp", "torn"), ("file.kept", "0")):
        (tmp_path / name).write_text(content)
    write_atomically(path, b"2", former)
    assert {each.name: each.read_text() for each in tmp_path.iterdir()} == {
        "file": "2",
        "former": "1",
    }


@pytest.mark.parametrize("name", ["file.tmp", "file.kept"])
def test_a_link_in_place_of_a_leftover_leads_nowhere(tmp_path: Path, name: str) -> None:
    """What it points to is not written to, and the link takes no file's place."""
    elsewhere, folder = tmp_path / "elsewhere", tmp_path / "folder"
    elsewhere.write_text("somebody else's")
    folder.mkdir()
    (folder / "file").write_text("1")
    (folder / name).symlink_to(elsewhere)
    write_atomically(folder / "file", b"2", folder / "former")
    assert elsewhere.read_text() == "somebody else's"
    assert not any(each.is_symlink() for each in folder.iterdir())
    assert {each.name: each.read_text() for each in folder.iterdir()} == {
        "file": "2",
        "former": "1",
    }


def test_a_folder_that_a_file_lacks_is_made_and_the_file_is_not(tmp_path: Path) -> None:
    check_new_file(tmp_path / "new" / "folder" / "new.json")
    assert list((tmp_path / "new" / "folder").iterdir()) == []


def test_a_folder_that_may_not_be_written_to_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(**_: object) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    with pytest.raises(
        InputError, match=r"new\.json cannot be written \(Permission denied\): name"
    ):
        check_new_file(tmp_path / "new.json")


def test_no_link_is_followed_to_a_file_elsewhere(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.write_text("precious")
    (tmp_path / "file.tmp").symlink_to(elsewhere)
    write_atomically(tmp_path / "file", b"new")
    assert (tmp_path / "file").read_bytes() == b"new"
    assert elsewhere.read_text() == "precious"


def test_a_pipe_in_place_of_a_file_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "table")
    with pytest.raises(OSError, match="No such device"):
        append_whole(tmp_path / "table", b"1")
