"""The start of a run with demonstrations: the replay gets them, once."""

import errno
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from common.errors import InputError
from common.protocol.run_keys import DEMONSTRATIONS, RunKeys
from common.run.folder import RunFolder
from common.settings.config import RunConfig
from learner.demonstrations import start
from learner.demonstrations.record import DemonstrationsRecord
from learner.demonstrations.recording import Demonstrations
from learner.demonstrations.start import begin_with, insert, insert_all
from replay.replay_buffer import ReplayBuffer
from replay.server import ReplayServer
from tests.actors.numbered_env import CUT, GOES_ON
from tests.in_process_transport import InProcessHub, InProcessTransport
from tests.recordings import CONFIG, SCRIPT, record, run_config


@contextmanager
def replay(folder: Path, config: RunConfig) -> Iterator[tuple[ReplayBuffer, InProcessTransport]]:
    hub = InProcessHub()
    buffer = ReplayBuffer(config, folder)
    with hub.connect() as transport, ReplayServer(transport, buffer, config, "r"):
        yield buffer, transport
    buffer.close()


def send(found: Demonstrations, buffer: ReplayBuffer, transport: InProcessTransport) -> list[str]:
    told: list[str] = []
    keys = RunKeys("r", buffer.run_id)
    sent = insert(found, transport, keys, threading.Event(), told.append)
    assert sent == replace(found.begun, complete=True)
    return told


def test_the_replay_takes_them_once_however_often_they_are_sent(tmp_path: Path) -> None:
    config = run_config()
    record(tmp_path / "d", SCRIPT, 48)
    with replay(tmp_path / "replay", config) as (buffer, transport):
        found = Demonstrations(tmp_path / "d", config)
        assert "48 steps" in send(found, buffer, transport)[0]
        send(found, buffer, transport)
        progress = buffer.progress(0)
        assert (progress.agent_steps, progress.stored, progress.refused) == (48, 48, 0)
        assert progress.duplicates == progress.accepted == 3 * (2 + 1)
        assert {each.actor for each in progress.statistics} == {DEMONSTRATIONS}
        # n-step returns reach to the ends of episodes, so that each step can be drawn.
        assert progress.samplable == 48
    with replay(tmp_path / "replay", config) as (buffer, transport):  # another process
        send(Demonstrations(tmp_path / "d", config), buffer, transport)
        assert buffer.progress(0).agent_steps == 48


def test_a_replay_that_is_just_large_enough_keeps_them_all(tmp_path: Path) -> None:
    config = run_config(capacity=50)
    record(tmp_path / "d", [*[GOES_ON] * 4, CUT], 50)  # cut games also leave a last frame each
    with replay(tmp_path / "replay", config) as (buffer, transport):
        assert "40 steps" in send(Demonstrations(tmp_path / "d", config), buffer, transport)[0]
        assert buffer.progress(0).stored == 40


def test_they_are_on_the_disk_before_they_count_as_sent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = run_config()
    record(tmp_path / "d", SCRIPT, 48)
    folder = RunFolder(tmp_path, "r")
    folder.path.mkdir()
    found, stop = Demonstrations(tmp_path / "d", config), threading.Event()
    with replay(tmp_path / "replay", config) as (buffer, transport):

        def fail() -> None:
            raise OSError(errno.EIO, os.strerror(errno.EIO))

        with monkeypatch.context() as power_fails:
            power_fails.setattr(buffer, "sync", fail)
            with pytest.raises(OSError, match="Input/output"):
                insert_all(found, transport, buffer, folder, stop, print)
        assert not folder.demonstrations.exists()
        assert insert_all(found, transport, buffer, folder, stop, print)
        begun = DemonstrationsRecord.of(folder)
        assert begun is not None
        assert begun.complete
        stop.set()
        assert not insert_all(found, transport, buffer, folder, stop, print)


def test_a_stop_ends_the_sending_and_a_replay_of_another_run_refuses(tmp_path: Path) -> None:
    config = run_config()
    record(tmp_path / "d", SCRIPT, 48)
    found = Demonstrations(tmp_path / "d", config)
    stop = threading.Event()
    stop.set()
    with replay(tmp_path / "replay", config) as (buffer, transport):
        assert not insert(found, transport, RunKeys("r", buffer.run_id), stop, print)
        with pytest.raises(InputError, match="it serves another run"):
            insert(found, transport, RunKeys("r", "another"), threading.Event(), print)
        assert 1 <= buffer.progress(0).refused <= config.stream.window


def test_a_malformed_reply_to_a_demonstration_is_told(tmp_path: Path) -> None:
    record(tmp_path / "d", SCRIPT, 48)
    found = Demonstrations(tmp_path / "d", run_config())
    hub = InProcessHub()
    with hub.connect() as server, hub.connect() as client:
        server.serve(RunKeys("r").insert("*"), lambda _: b"garbage")
        with pytest.raises(InputError, match=r"^the replay refused a demonstration: "):
            insert(found, client, RunKeys("r", "run"), threading.Event(), print)


def test_a_replay_that_does_not_answer_is_waited_for_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(start, "_PATIENCE", 2)
    record(tmp_path / "d", SCRIPT, 48)
    found = Demonstrations(tmp_path / "d", run_config())
    stop = threading.Event()
    told: list[str] = []

    def tell(text: str) -> None:
        told.append(text)
        stop.set()

    nobody = InProcessTransport(InProcessHub())
    assert not insert(found, nobody, RunKeys("r", "run"), stop, tell)
    assert told == ["the replay does not answer; the demonstrations wait for it."]


def test_a_long_path_is_a_path(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path, "r")
    folder.path.mkdir()
    begun = DemonstrationsRecord("/" + "a/" * 1_000, "0" * 64, 5)
    folder.demonstrations.write_bytes(begun.encode())
    assert DemonstrationsRecord.of(folder) == begun


def test_a_run_begins_with_one_recording_and_goes_on_where_that_was_interrupted(
    tmp_path: Path,
) -> None:
    for name, steps in (("d", 48), ("other", 32)):
        record(tmp_path / name, SCRIPT, steps)
    folder = RunFolder(tmp_path, "r")
    folder.path.mkdir()

    def begun(given: str | None, *, resume: bool) -> Any:
        path = None if given is None else tmp_path / given
        found = begin_with(path, CONFIG, folder, resume=resume)
        return None if found is None else found.begun.steps

    assert begun(None, resume=False) is None
    assert begun("d", resume=False) == 48
    first = Demonstrations(tmp_path / "d", CONFIG).begun
    folder.demonstrations.write_bytes(first.encode())
    assert DemonstrationsRecord.of(folder) == first
    # Killed before all were sent: with the flag or without it.
    assert begun("d", resume=True) == begun(None, resume=True) == 48
    folder.demonstrations.write_bytes(replace(first, complete=True).encode())
    assert begun("d", resume=True) is begun(None, resume=True) is None
    (tmp_path / "d").rename(tmp_path / "moved")
    assert begun("d", resume=True) is None  # it is not even read
    assert begun("moved", resume=True) is None  # the same by its content
    (tmp_path / "moved").rename(tmp_path / "d")
    with pytest.raises(InputError, match=r"did not begin with the demonstrations .* omit --demo"):
        begun("other", resume=True)
    folder.demonstrations.unlink()
    for told in (folder.checkpoint, folder.previous, folder.epochs):
        told.touch()
        with pytest.raises(InputError, match="did not begin with"):
            begun("d", resume=True)
        told.unlink()
    folder.demonstrations.write_text("{}")
    with pytest.raises(InputError, match=r"demonstrations.json is damaged .*: repair or"):
        begun(None, resume=True)
