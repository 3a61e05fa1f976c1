"""A run is copied as a power failure would leave it."""

import errno
import os
import tempfile
import threading
from pathlib import Path
from typing import Any

import pytest

from common.errors import InputError
from common.exit_codes import INTERRUPTED
from common.run.folder import RunFolder
from learner import backup
from learner.backup import BackupOptions, back_up


@pytest.fixture
def run(tmp_path: Path) -> RunFolder:
    folder = RunFolder(tmp_path / "runs", "r")
    for path, content in (
        (folder.config_file, "{}"),
        (folder.checkpoint, "new"),
        (folder.previous, "old"),
        (folder.epochs, "epoch"),
        (folder.replay / "journal.jsonl", "chunks"),
        (folder.replay / "actions.bin", "rows"),
        (folder.snapshots / "best.safetensors", "best"),
        (folder.path / ".learner.lock", ""),
        (folder.path / "checkpoint.safetensors.tmp", "half"),
        (folder.path / "checkpoint.safetensors.kept", "old"),
    ):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    return folder


def content(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): path.read_text()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_all_files_are_copied_but_for_what_is_half_written(run: RunFolder, tmp_path: Path) -> None:
    run.newest_learner.touch()  # the copy is another run, at which no learner has worked
    copy = back_up(BackupOptions(run.path, tmp_path / "copy"), threading.Event())[1].path
    assert copy == tmp_path / "copy"
    assert content(copy) == {
        "config.json": "{}",
        "checkpoint.safetensors": "new",
        "checkpoint.previous.safetensors": "old",
        "epochs.csv": "epoch",
        "replay/journal.jsonl": "chunks",
        "replay/actions.bin": "rows",
        "snapshots/best.safetensors": "best",
    }
    assert sorted(path.name for path in tmp_path.iterdir()) == ["copy", "runs"]


def test_what_a_file_in_the_run_links_to_is_not_copied(run: RunFolder, tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("secret")
    (run.path / "notes.txt").symlink_to(tmp_path / "secret")
    (run.snapshots / "notes.txt").symlink_to("/etc/hostname")
    copy = back_up(BackupOptions(run.path, tmp_path / "copy"), threading.Event())[1].path
    assert not any("notes.txt" in name for name in content(copy))


@pytest.mark.parametrize("named", ["first", "runs/first"])
def test_a_run_that_is_linked_is_copied(
    named: str, run: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here" / "runs").mkdir(parents=True)
    (tmp_path / "here" / "runs" / "first").symlink_to(run.path)
    monkeypatch.chdir(tmp_path / "here")
    copy = back_up(BackupOptions(Path(named), tmp_path / "copy"), threading.Event())[1].path
    assert "config.json" in content(copy)


def test_the_command_to_go_on_can_be_pasted(
    run: RunFolder,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    copy = tmp_path / "my runs" / "r2"  # which makes both
    monkeypatch.setattr("sys.argv", ["learner.backup", str(run.path), "-o", str(copy)])
    backup.main()
    told = capsys.readouterr().out
    assert f"train --resume --runs '{copy.parent}' --run r2\n" in told
    assert "The copy is called r2: to let the actors of r join it" in told


def test_a_replay_alone_goes_on_as_a_replay(
    run: RunFolder,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    run.checkpoint.unlink()
    run.previous.unlink()
    copy = tmp_path / "r"
    monkeypatch.setattr("sys.argv", ["learner.backup", str(run.path), "-o", str(copy)])
    backup.main()
    told = capsys.readouterr().out
    assert f"ale-robot replay --resume --runs {tmp_path} --run r\n" in told
    assert "The copy is called" not in told


def test_the_copy_is_for_its_owner_alone(run: RunFolder, tmp_path: Path) -> None:
    key = run.path / "certificates" / "ca-key.pem"
    key.parent.mkdir()
    key.touch(mode=0o600)
    copy = back_up(BackupOptions(run.path, tmp_path / "copy"), threading.Event())[1].path
    assert (copy / "certificates" / "ca-key.pem").stat().st_mode & 0o777 == 0o600
    assert copy.stat().st_mode & 0o777 == 0o700


def test_a_place_where_nothing_can_be_made_is_refused(
    run: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuses(**_: Any) -> str:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(tempfile, "mkdtemp", refuses)
    with pytest.raises(InputError, match=r"copy cannot be written \(Read-only.*: name another"):
        back_up(BackupOptions(run.path, tmp_path / "copy"), threading.Event())


def test_a_copy_that_is_stopped_leaves_nothing(
    run: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop = threading.Event()
    original = Path.open

    def opens(path: Path, *args: Any) -> Any:
        if path == run.epochs:  # the checkpoint has been copied by then
            stop.set()
        return original(path, *args)

    monkeypatch.setattr(Path, "open", opens)
    with pytest.raises(InputError, match="nothing of it is left: copy again") as stopped:
        back_up(BackupOptions(run.path, tmp_path / "copy"), stop)
    assert stopped.value.exit_code == INTERRUPTED
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]


def test_a_replay_on_another_disk_is_copied(run: RunFolder, tmp_path: Path) -> None:
    elsewhere = run.replay.rename(tmp_path / "disk")
    run.replay.symlink_to(elsewhere)
    copy = back_up(BackupOptions(run.path, tmp_path / "copy"), threading.Event())[1].path
    assert (copy / "replay" / "actions.bin").read_text() == "rows"
    assert not (copy / "replay").is_symlink()


def test_what_the_copy_rests_on_comes_first(
    run: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run works on between any two files."""
    opened: list[str] = []
    original = Path.open

    def work_on(path: Path, mode: str = "r", **how: Any) -> object:
        if mode == "rb":
            opened.append(path.name)
            if len(opened) == 1:
                (run.replay / "journal.jsonl").write_text("chunks, and one more")
            if len(opened) == 3:
                (run.snapshots / "best.safetensors").unlink()
        return original(path, mode, **how)

    monkeypatch.setattr(Path, "open", work_on)
    copy = back_up(BackupOptions(run.path, tmp_path / "copy"), threading.Event())[1].path
    monkeypatch.undo()
    assert opened[:3] == [
        "checkpoint.safetensors", "checkpoint.previous.safetensors", "journal.jsonl",
    ]  # fmt: skip
    assert opened[-1] == "config.json"  # until then nobody takes it for a run
    found = content(copy)
    assert found["replay/journal.jsonl"] == "chunks, and one more"
    assert "snapshots/best.safetensors" not in found


@pytest.mark.parametrize(
    ("source", "target", "words"),
    [
        ("runs", "copy", r"runs is not a run: name one"),
        ("runs/r", "runs", r"runs already exists"),
        ("runs/r", "runs/r/copy", r"copy is inside of the run"),
        ("runs/r", "a b", r"run 'a b' cannot be used"),
    ],
)
def test_what_cannot_be_copied_is_told(
    run: RunFolder, tmp_path: Path, source: str, target: str, words: str
) -> None:
    before = content(tmp_path)
    with pytest.raises(InputError, match=words):
        back_up(BackupOptions(tmp_path / source, tmp_path / target), threading.Event())
    assert content(tmp_path) == before


def test_a_copy_that_fails_leaves_nothing(
    run: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full() -> None:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr("learner.backup.os.sync", full)
    with pytest.raises(OSError, match="No space left"):
        back_up(BackupOptions(run.path, tmp_path / "copy"), threading.Event())
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]
