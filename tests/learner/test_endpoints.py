"""A learner at another process' replay: who else may train the run. Its pages."""

import threading
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from common.endpoint import check_free
from common.errors import InputError
from common.protocol.run_keys import RunKeys
from common.run.announcement import Announcement
from common.run.folder import RunFolder
from common.settings.presets import PRESETS
from common.transport.interface import Transport
from learner.endpoints import open_pages, open_replay
from learner.options import LearnerOptions
from learner.telemetry.sinks.status import StatusSink
from tests.learner.telemetry.snapshots import snapshot

CONFIG = PRESETS["fast"]
KEYS = RunKeys("r", "id")
Opens = Callable[[], Any]


@pytest.fixture
def opens(
    hub: Transport, client: Transport, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Opens]:
    """Opens the replay of run r at ``hub``, as a second learner does from a folder of its own."""
    told = Announcement("r", CONFIG, CONFIG.action_count, "id").encode()
    hub.serve(KEYS.config, lambda _: told)
    monkeypatch.setattr("learner.endpoints.connect", lambda *_, **__: nullcontext(client))
    options = LearnerOptions(CONFIG, run="r", connect="tcp/127.0.0.1:9")
    stop = threading.Event()
    yield lambda: open_replay(options, RunFolder(tmp_path, "r"), stop)
    stop.set()


def test_a_run_without_a_learner_gets_one(opens: Opens) -> None:
    with opens() as (_, replay, endpoint):
        assert (replay.run_id, endpoint) == ("id", "tcp/127.0.0.1:9")


def test_a_replay_is_let_go_at_the_end_of_a_run_too(
    opens: Opens, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Which tells the last priorities; at a stop a thread does."""
    closed: list[str] = []
    monkeypatch.setattr("learner.endpoints.RemoteReplay.close", lambda _: closed.append("replay"))
    with opens():
        assert closed == []
    assert closed == ["replay"]


@pytest.mark.parametrize("starting", [True, False])
def test_a_second_learner_is_refused_even_while_the_first_one_starts(
    opens: Opens, hub: Transport, starting: bool
) -> None:
    first = StatusSink(hub, KEYS)
    if not starting:
        first.write(snapshot({}))
    with (
        pytest.raises(InputError, match=r"^another learner trains r at tcp/127\.0\.0\.1:9, "),
        opens(),
    ):
        pass


def test_a_start_that_fails_leaves_no_page_listening(tmp_path: Path) -> None:
    options = LearnerOptions(CONFIG, web="127.0.0.1:0")
    with (
        pytest.raises(InputError) as error,
        open_pages(options, RunFolder(tmp_path, "r")) as (_, url),
    ):
        raise InputError(f"{url}")
    # The error keeps the failed call's variables alive.
    check_free("127.0.0.1", int(str(error.value).rstrip("/").rpartition(":")[2]))
