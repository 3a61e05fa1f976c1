"""Owners of a run's folder, and what a claim refuses."""

import fcntl
import json
import os
import signal
import struct
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from common.atomic_file import write_atomically
from common.errors import InputError
from common.run.epochs import EpochTable
from common.run.folder import JOURNAL, Part, RunFolder
from common.settings.config import RunConfig
from common.settings.presets import PRESETS
from learner.demonstrations.record import DemonstrationsRecord
from replay.journal import read_journal
from tests.paths import ROOT
from tests.patience import PATIENCE

FAST = PRESETS["fast"]


def claim(
    runs: Path,
    part: Part = "learner",
    config: RunConfig = FAST,
    *,
    name: str = "r",
    resume: bool = False,
) -> RunFolder:
    folder = RunFolder(runs, name)
    folder.claim(part, config, resume=resume)
    return folder


def test_a_new_run_keeps_its_configuration(tmp_path: Path) -> None:
    assert RunFolder(tmp_path, "r").stored_config() is None
    folder = claim(tmp_path)
    assert folder.path == tmp_path / "r"
    assert folder.stored_config() == RunFolder(tmp_path, "r").stored_config() == FAST
    assert json.loads(folder.config_file.read_text())["game"] == "pong"


def test_everything_of_a_run_lies_in_its_folder(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path, "r")
    places = [
        folder.config_file,
        folder.checkpoint,
        folder.snapshots,
        folder.epochs,
        folder.summary,
        folder.tensorboard,
        folder.replay,
    ]
    assert len(set(places)) == len(places)
    assert all(place.parent == tmp_path / "r" for place in places)


def test_a_run_is_found_from_inside_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    claim(tmp_path, name="run")
    inside = tmp_path / "run" / "snapshots"
    inside.mkdir()
    for place, path in ((inside.parent, "."), (inside, ".."), (tmp_path, "run")):
        monkeypatch.chdir(place)
        run = RunFolder.at(Path(path))
        assert run is not None
        assert (run.name, run.path.resolve()) == ("run", inside.parent)
    monkeypatch.chdir(tmp_path)
    assert RunFolder.at(Path()) is None


def test_a_run_is_found_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    claim(Path("runs"), name="first")
    (tmp_path / "first").mkdir()  # no run
    run = RunFolder.named(Path("first"))
    assert run is not None
    assert run.path == Path("runs/first")
    for elsewhere in ("other/first", "second", tmp_path / "first"):
        assert RunFolder.named(Path(elsewhere)) is None
    assert RunFolder.at(Path("first")) is None
    (tmp_path / "first").rmdir()
    claim(Path(), name="first")  # the folder of that name is meant rather
    run = RunFolder.named(Path("first"))
    assert run is not None
    assert run.path == Path("first")


def test_a_name_that_leads_elsewhere_is_refused(tmp_path: Path) -> None:
    for name in ("..", "../r", "/tmp", ""):
        with pytest.raises(InputError, match="cannot be used"):
            RunFolder(tmp_path, name)


def test_resuming_needs_a_run(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"there is no run in .* to resume: start it without"):
        claim(tmp_path, resume=True)
    assert not (tmp_path / "r").exists()


def test_resuming_a_name_that_is_almost_a_runs_names_that_run(tmp_path: Path) -> None:
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
    (tmp_path / "first" / "config.json").touch()
    with pytest.raises(InputError, match=r"frist to resume: did you mean first\?$"):
        claim(tmp_path, name="frist", resume=True)
    with pytest.raises(InputError, match=r"secnd to resume: start it without"):  # no run's folder
        claim(tmp_path, name="secnd", resume=True)


@pytest.mark.parametrize("left", ["checkpoint", "previous"])
def test_a_run_that_has_begun_needs_resume(tmp_path: Path, left: str) -> None:
    first = claim(tmp_path)
    getattr(first, left).write_bytes(b"x")
    with pytest.raises(InputError, match="holds a run: a learner is at work there: name another"):
        claim(tmp_path)
    del first  # closes its locks
    with pytest.raises(InputError, match="already holds a run: go on with it by --resume"):
        claim(tmp_path)


def test_a_run_that_ended_before_it_began_may_start_again(tmp_path: Path) -> None:
    first = claim(tmp_path)
    del first  # closes its locks
    assert claim(tmp_path).stored_config() == FAST


def test_a_start_that_failed_binds_nobody_to_its_settings(tmp_path: Path) -> None:
    other = replace(FAST, seed=2)
    folder = claim(tmp_path)
    with pytest.raises(InputError, match="keeps its settings"):  # it is still at work
        claim(tmp_path, "replay", other)
    del folder
    assert claim(tmp_path, config=other).stored_config() == other


def test_a_replay_binds_the_learner(tmp_path: Path) -> None:
    """Also once it has ended."""
    folder = claim(tmp_path, "replay")
    folder.replay.mkdir()
    del folder
    with pytest.raises(InputError, match=r"\(seed 1 → 2\): take .*: --run ANOTHER, without"):
        claim(tmp_path, config=replace(FAST, seed=2))


def test_a_learner_binds_the_replay(tmp_path: Path) -> None:
    path = claim(tmp_path).checkpoint
    path.touch()
    for resume in (False, True):
        with pytest.raises(InputError, match=f": --run ANOTHER --initial {path.parent}, without"):
            claim(tmp_path, "replay", replace(FAST, seed=2), resume=resume)


def test_a_run_may_be_older_than_a_setting(tmp_path: Path) -> None:
    folder = claim(tmp_path)
    told = json.loads(folder.config_file.read_text())
    del told["learning"]["random_shift"]
    folder.config_file.write_text(json.dumps(told))
    assert folder.stored_config() == FAST


def test_a_resumed_run_keeps_its_configuration(tmp_path: Path) -> None:
    folder = claim(tmp_path)
    folder.checkpoint.write_bytes(b"x")
    written = folder.config_file.stat().st_mtime_ns
    del folder
    assert claim(tmp_path, resume=True).config_file.stat().st_mtime_ns == written


@pytest.mark.parametrize("resume", [False, True])
def test_another_configuration_is_refused_with_the_differences(
    tmp_path: Path, resume: bool
) -> None:
    folder = claim(tmp_path)
    other = replace(FAST, seed=2, game="breakout")
    with pytest.raises(InputError, match=r"\(game pong → breakout; seed 1 → 2\)"):
        claim(tmp_path, "replay", other, resume=resume)
    assert folder.stored_config() == FAST


def test_learner_and_replay_that_start_at_once_settle_one_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits, refused, control = threading.Event(), list[str](), fcntl.fcntl

    def begin_the_replay() -> None:
        try:
            claim(tmp_path, "replay", PRESETS["paper"])
        except InputError as error:
            refused.append(str(error))
        waits.set()

    replay = threading.Thread(target=begin_the_replay)

    def watched(file: Any, command: int, lock: bytes) -> Any:
        if command == fcntl.F_OFD_SETLKW and threading.current_thread() is replay:
            waits.set()
        return control(file, command, lock)

    def write(path: Path, content: bytes) -> None:
        if threading.current_thread() is not replay:
            replay.start()
            assert waits.wait(PATIENCE)
        write_atomically(path, content)

    monkeypatch.setattr(fcntl, "fcntl", watched)
    monkeypatch.setattr("common.run.folder.write_atomically", write)
    folder = claim(tmp_path, "learner", FAST)
    replay.join(PATIENCE)
    assert len(refused) == 1
    assert "keeps its settings" in refused[0]
    assert folder.stored_config() == FAST


def test_learner_and_replay_share_a_run(tmp_path: Path) -> None:
    folder = claim(tmp_path)
    folder.claim("replay", FAST, resume=False)
    with pytest.raises(InputError, match=r"^another replay is at work in"):
        claim(tmp_path, "replay")


def test_who_only_looks_whether_a_part_is_at_work_does_not_keep_it_from_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = claim(tmp_path, "replay")
    (tmp_path / "r/.learner.lock").touch()
    look = struct.unpack_from
    claims: list[RunFolder] = []

    def claim_meanwhile(*found: Any) -> tuple[Any, ...]:  # the file is open, and was looked at
        patched.undo()
        claims.append(claim(tmp_path))
        return look(*found)

    with monkeypatch.context() as patched:
        patched.setattr("common.run.folder.struct.unpack_from", claim_meanwhile)
        assert not folder.is_at_work("learner")
    assert folder.is_at_work("learner")
    del claims[:]
    assert not folder.is_at_work("learner")
    assert folder.is_at_work("replay")


HOLDER = """
import sys
from pathlib import Path
from common.settings.presets import PRESETS
from learner.demonstrations.record import DemonstrationsRecord
from replay.journal import read_journal
from common.run.folder import RunFolder

folder = RunFolder(Path(sys.argv[1]), "r")
folder.claim("learner", PRESETS["fast"], resume=False)
folder.checkpoint.write_bytes(b"x")
print("held", flush=True)
sys.stdin.read()
"""


def test_another_processs_part_is_locked_until_that_process_is_dead(tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(tmp_path)],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(InputError, match=r"^another learner is at work in"):
            claim(tmp_path, resume=True)
        holder.send_signal(signal.SIGKILL)
        holder.wait()
    claim(tmp_path, resume=True)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"{}", b"\xff\xfe", b'{"game": 5}'])
def test_a_spoiled_configuration_is_told_with_its_place(tmp_path: Path, content: bytes) -> None:
    folder = claim(tmp_path)
    folder.config_file.write_bytes(content)
    with pytest.raises(InputError, match=str(folder.config_file)):
        folder.stored_config()


def test_a_folder_that_cannot_be_is_told(tmp_path: Path) -> None:
    (tmp_path / "r").write_text("a file where the folder should be")
    with pytest.raises(InputError, match="cannot be"):
        claim(tmp_path)
    (tmp_path / "runs").write_text("")
    with pytest.raises(InputError, match="cannot be"):
        claim(tmp_path / "runs")


def test_a_start_that_fails_leaves_no_folder(tmp_path: Path) -> None:
    folder = claim(tmp_path)
    folder.initial.touch()
    folder.logs.mkdir()
    (folder.logs / "learner.jsonl").touch()
    folder.claim("replay", FAST, resume=False)
    folder.gates.touch()
    folder.newest_learner.touch()
    for made in (folder.replay, folder.tensorboard):
        made.mkdir()
        (made / "file").touch()
    with pytest.raises(InputError), folder.removed_if_unused():
        raise InputError("the replay refused a demonstration.")
    assert not folder.path.exists()


@pytest.mark.parametrize("left", ["checkpoint", "epochs"])
def test_a_failure_after_the_first_checkpoint_costs_nothing(tmp_path: Path, left: str) -> None:
    folder = claim(tmp_path)
    folder.claim("replay", FAST, resume=False)
    folder.replay.mkdir()
    getattr(folder, left).touch()
    with pytest.raises(InputError), folder.removed_if_unused():
        raise InputError("the loss became non-finite.")
    assert folder.replay.exists()


def test_a_failed_learner_leaves_a_replay_of_its_own_process(tmp_path: Path) -> None:
    folder = claim(tmp_path)
    replay = claim(tmp_path, "replay")
    replay.replay.mkdir()
    with pytest.raises(InputError), folder.removed_if_unused():
        raise InputError("--track x needs a package.")
    assert folder.replay.exists()


def test_a_failed_learner_leaves_a_replay_that_it_never_claimed(tmp_path: Path) -> None:
    folder = claim(tmp_path)
    folder.replay.mkdir()
    with pytest.raises(InputError), folder.removed_if_unused():
        raise InputError("--track x needs a package.")
    assert folder.replay.exists()


def test_a_start_that_fails_leaves_another_parts_folder(tmp_path: Path) -> None:
    replay = claim(tmp_path, "replay")
    with replay.removed_if_unused():
        claim(tmp_path, "learner")
    assert replay.config_file.exists()


def test_a_folder_in_which_something_began_or_that_was_there_stays(tmp_path: Path) -> None:
    there = claim(tmp_path)
    with there.removed_if_unused():
        there.replay.mkdir()
    assert there.replay.exists()
    there.replay.rmdir()
    (tmp_path / "made").mkdir()
    for again in (claim(tmp_path, "replay"), claim(tmp_path, name="made")):
        with again.removed_if_unused():
            pass
        assert again.path.exists()


def test_no_link_in_place_of_a_lock_is_followed(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.write_text("precious")
    (tmp_path / "r").mkdir()
    (tmp_path / "r" / ".learner.lock").symlink_to(elsewhere)
    with pytest.raises(InputError, match=r"cannot be written \(Too many levels of symbolic links"):
        claim(tmp_path)
    assert elsewhere.read_text() == "precious"


def test_pipes_in_place_of_a_runs_files_are_not_waited_for(tmp_path: Path) -> None:
    """As in a folder that somebody gave: who opens a pipe waits for its other end for ever."""
    folder = claim(tmp_path)
    why = "it is not a regular file"
    for pipe in (folder.epochs, folder.demonstrations, folder.replay / JOURNAL):
        pipe.parent.mkdir(exist_ok=True)
        os.mkfifo(pipe)
    with pytest.raises(InputError, match=why):
        EpochTable(folder.epochs).rows()
    with pytest.raises(InputError, match=why):
        DemonstrationsRecord.of(folder)
    with pytest.raises(InputError, match=why):
        read_journal(folder.replay / JOURNAL)
    folder.config_file.unlink()
    os.mkfifo(folder.config_file)
    with pytest.raises(InputError, match=why):
        folder.stored_config()


def test_a_pipe_in_place_of_a_lock_is_not_waited_for(tmp_path: Path) -> None:
    (tmp_path / "r").mkdir()
    os.mkfifo(tmp_path / "r" / ".learner.lock")
    with pytest.raises(InputError, match="No such device"):
        claim(tmp_path)
